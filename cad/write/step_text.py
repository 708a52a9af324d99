"""The text of a STEP assembly in one order: what the kernel's memory addresses and counters leave in it, taken out.

Open CASCADE numbers the placed components of a process (`NEXT_ASSEMBLY_USAGE_OCCURRENCE`), and writes colours in the
order of a map whose keys are memory addresses. The geometry before them comes in the order it was given in.
"""

from __future__ import annotations

import re

# "#12 = NAME(...);", over several lines; and, within its body, quoted text or a reference.
ENTITY = re.compile(r"^#(\d+) = (.*?);$", re.DOTALL | re.MULTILINE)
TOKEN = re.compile(r"'(?:[^']|'')*'|#(\d+)")
COLOURS = "MECHANICAL_DESIGN_GEOMETRIC_PRESENTATION_REPRESENTATION"
PLACED = re.compile(r"^NEXT_ASSEMBLY_USAGE_OCCURRENCE\('\d+'")


def ordered_step(text: str) -> str:
    """A STEP file's text with its components counted from 1, and its colours in the order of what they colour."""
    start, _, rest = text.partition("DATA;\n")
    data, _, end = rest.partition("ENDSEC;")
    bodies = {int(number): re.sub(r"\n\s*", "", body) for number, body in ENTITY.findall(data)}
    refers = {number: _references(body) for number, body in bodies.items()}
    referred = {other for others in refers.values() for other in others}
    roots = [number for number in bodies if number not in referred]
    colours = [root for root in roots if bodies[root].startswith(COLOURS)]
    plain = {number for root in roots if root not in colours for number in _below(root, refers)}

    def coloured(root: int) -> list[int]:
        return sorted(other for number in _below(root, refers) for other in refers[number] if other in plain)

    # Those that colours share come with the first that has them.
    order = dict.fromkeys(sorted(plain))
    for root in sorted(colours, key=coloured):
        order |= dict.fromkeys(number for number in _below(root, refers) if number not in order)
    new = {number: place for place, number in enumerate(order, start=1)}
    placed = 0
    lines = []
    for number in order:
        body, components = PLACED.subn(f"NEXT_ASSEMBLY_USAGE_OCCURRENCE('{placed + 1}'", bodies[number])
        placed += components
        body = TOKEN.sub(lambda token: f"#{new[int(token[1])]}" if token[1] else token[0], body)
        lines.append(f"#{new[number]} = {body};\n")
    return f"{start}DATA;\n{''.join(lines)}ENDSEC;{end}"


def _references(body: str) -> list[int]:
    return [int(token[1]) for token in TOKEN.finditer(body) if token[1]]


def _below(root: int, refers: dict[int, list[int]]) -> list[int]:
    """An entity and all that it refers to, directly or not, in the order in which they are met."""
    found, waiting = {root: None}, [root]
    while waiting:
        fresh = [other for other in refers[waiting.pop()] if other not in found]
        found |= dict.fromkeys(fresh)
        waiting += reversed(fresh)
    return list(found)
