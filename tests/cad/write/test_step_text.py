"""Text of STEP files: the same whatever was written before."""

from __future__ import annotations

from mirrorcam.cad.write.step_text import ordered_step

GEOMETRY = """#1 = SOLID('it''s #3',#2);
#2 = POINT('',(0.,1.),
  $);
#3 = SOLID('b',#2);
#4 = NEXT_ASSEMBLY_USAGE_OCCURRENCE('{0}','a','',#1,#3,$);
#5 = NEXT_ASSEMBLY_USAGE_OCCURRENCE('{1}','b','',#3,#1,$);
"""


COLOUR = "MECHANICAL_DESIGN_GEOMETRIC_PRESENTATION_REPRESENTATION"


def step(counts: tuple[int, int], colours: str) -> str:
    return f"ISO-10303-21;\nHEADER;\nENDSEC;\nDATA;\n{GEOMETRY.format(*counts)}{colours}ENDSEC;\nEND-ISO-10303-21;\n"


def test_counts_and_the_order_of_colours_leave_no_trace() -> None:
    colours = (
        f"#6 = {COLOUR}((#7));\n#7 = ITEM(#8,#{{}});\n#8 = RGB(1.);\n#9 = {COLOUR}((#10));\n#10 = ITEM(#8,#{{}});\n"
    )
    one, two = step((1, 2), colours.format(1, 3)), step((7, 8), colours.format(3, 1))
    assert one != two
    assert ordered_step(one) == ordered_step(two)
    assert "#1 = SOLID('it''s #3',#2);\n#2 = POINT('',(0.,1.),$);" in ordered_step(two)
    assert "OCCURRENCE('1','a'" in ordered_step(two)
    # What differs in more than that still differs.
    assert ordered_step(step((1, 2), colours.format(1, 1))) != ordered_step(two)
