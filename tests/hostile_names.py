"""Names that other people's files may hold: what every written format has to show as text, and what is refused."""

from __future__ import annotations

from mirrorcam.core.names import LONGEST

ACCEPTED = (
    *("", " ", "a b", "\"double\" 'single'", "<img src=x onerror=alert(1)>", "</code></pre><script>alert(1)</script>"),
    *("=1+1", "+1", "-1", "@SUM(A1)", "../../secret", "/etc/passwd", "# a: b", "- [a, b]", "{a: b}", "null", "%s"),
    *("&lt;b&gt;", "]]>", "-->", "$\\frac{1}{2}$", "${x}", "a\\nb", "a | b", "Spiegel ä 鏡 🪞", "W" * LONGEST),
)
REFUSED = (
    *("a\nb", "a\tb", "\x00", "\x1b[2J", "a\u2028b", "\u202eevil", "\ufeff", "\ud800", "x" * (LONGEST + 1), "x" * 300),
)
