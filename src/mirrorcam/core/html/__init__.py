"""The kit of all HTML pages: a base template, one style sheet and macros; `templates.render` fills a page in."""
