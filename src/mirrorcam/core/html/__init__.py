"""Kit of all HTML pages: a base template, a style sheet and macros, rendered by `templates.render`."""
