"""Depth of light fields beside OpenCV's stereo and beside the truth, and how fast it is.

`python -m benchmarks.light_field_depth scenes SCENE[=TRUTH.pfm]... [--every N] [--fast]` scores scenes in the format of
the 4D Light Field Benchmark (its own, those of `benchmarks.depth_scenes`, or recordings), of which every Nth view is
taken. A folder that does not exist gets a rendered tabletop scene first (minutes). The truth is that of the scene, or a
disparity map, px per view step of the full grid; one that is smaller than the views lacks as much at every side. BadPix
and MSE are those of the benchmark; beside them stand the best of all pairs and settings of StereoSGBM, chosen by the
truth. Errors in standard deviations leave out what lies within 4 px of a depth edge of the truth.

`python -m benchmarks.light_field_depth speed [--rounds N]` times both qualities, StereoSGBM of two neighbouring views
and remaps of all views, for more pixels and for more views over the same baselines.
"""

from __future__ import annotations

import argparse

from benchmarks.light_field_depth.scenes import judge
from benchmarks.light_field_depth.speed import speed
from benchmarks.records import add_json_option, write_record


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    jobs = parser.add_subparsers(dest="job", required=True)
    scored, timed = jobs.add_parser("scenes"), jobs.add_parser("speed")
    scored.add_argument("scenes", nargs="+", metavar="SCENE[=TRUTH.pfm]")
    scored.add_argument("--every", type=int, default=1, help="take every Nth view of a whole scene")
    scored.add_argument("--step", type=int, help="steps of the full grid between views, if some are absent")
    scored.add_argument("--fast", action="store_true")
    timed.add_argument("--rounds", type=int, default=10)
    for job in (scored, timed):
        add_json_option(job)
    given = parser.parse_args()
    if given.job == "speed":
        write_record(given.json, "light_field_depth_speed", table=speed(given.rounds).table)
    else:
        rows = judge(given.scenes, given.every, given.step, "fast" if given.fast else "best")
        write_record(given.json, "light_field_depth_scenes", table=rows.table)


if __name__ == "__main__":
    main()
