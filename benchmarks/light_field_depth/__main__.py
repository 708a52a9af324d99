"""Depth of light fields compared with OpenCV's stereo and with the truth, and its speed.

`python -m benchmarks.light_field_depth scenes SCENE[=TRUTH.pfm]... [--every N] [--fast]` scores scenes in the format of
the 4D Light Field Benchmark (its own, those of `benchmarks.depth_scenes`, or recordings), using every Nth view. If a
folder does not exist, a tabletop scene is rendered into it first (minutes). The truth is the scene's, or a disparity
map, px per view step of the full grid; a map smaller than the views is centred in them. BadPix and MSE are the
benchmark's; for comparison, the best of all pairs and settings of StereoSGBM, chosen by the truth. Errors in standard
deviations exclude pixels within 4 px of a true depth edge.

`python -m benchmarks.light_field_depth speed [--rounds N]` times both qualities, a frame of a video, StereoSGBM of two
neighbouring views and remaps of all views, for more pixels, for more views over the same baselines and for more planes:
processor time of one thread, and wall time of two.
"""

from __future__ import annotations

import argparse

from benchmarks.light_field_depth.scenes import print_scores
from benchmarks.light_field_depth.speed import speed
from benchmarks.records import add_json_option, write_record


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    jobs = parser.add_subparsers(dest="job", required=True)
    scenes_parser, speed_parser = jobs.add_parser("scenes"), jobs.add_parser("speed")
    scenes_parser.add_argument("scenes", nargs="+", metavar="SCENE[=TRUTH.pfm]")
    scenes_parser.add_argument("--every", type=int, default=1, help="use every Nth view of a complete scene")
    scenes_parser.add_argument("--step", type=int, help="steps of the full grid between views, if some are absent")
    scenes_parser.add_argument("--fast", action="store_true")
    speed_parser.add_argument("--rounds", type=int, default=10)
    for job in (scenes_parser, speed_parser):
        add_json_option(job)
    options = parser.parse_args()
    if options.job == "speed":
        write_record(options.json, "light_field_depth_speed", table=speed(options.rounds).table)
    else:
        rows = print_scores(options.scenes, options.every, options.step, "fast" if options.fast else "best")
        write_record(options.json, "light_field_depth_scenes", table=rows.table)


if __name__ == "__main__":
    main()
