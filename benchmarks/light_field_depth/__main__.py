"""Depth of light fields compared with OpenCV's stereo and with the truth, and its speed.

`python -m benchmarks.light_field_depth scenes SCENE[=TRUTH.pfm]... [--every N] [--fast]` scores scenes in the format of
the 4D Light Field Benchmark (its own, those of `benchmarks.depth_scenes`, or recordings), using every Nth view. If a
folder does not exist, a tabletop scene is rendered into it first (minutes). The truth is the scene's, or a disparity
map, px per view step of the full grid; a map smaller than the views is centred in them. BadPix and MSE are the
benchmark's; for comparison, the best of all pairs and settings of StereoSGBM, chosen by the truth. Errors in standard
deviations exclude pixels within 4 px of a true depth edge.

`python -m benchmarks.light_field_depth confidence [--train SCENE...] [--test SCENE...] [--fast]` fits the coefficients
of confidence to some scenes, and prints how well confidence and sigma hold on others: as they are, with noise, as
simulated webcams photograph them, searched over wide and wrong ranges, with views in a wrong order, with fewer views,
and on rooms with bare walls. A scene may also be a folder of a rectified pair as Middlebury publishes it.

`python -m benchmarks.light_field_depth speed [--rounds N]` times both qualities, a frame of a video, StereoSGBM of two
neighbouring views and remaps of all views, for more pixels, for more views over the same baselines and for more planes:
processor time of one thread, and wall time of two.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from benchmarks.light_field_depth.scenes import print_scores
from benchmarks.light_field_depth.speed import speed
from benchmarks.light_field_depth.training import TEST_SEED, TRAINING_SEED, cases, report, store, train, tried
from benchmarks.records import add_json_option, write_record
from mirrorcam.optics.light_field.depth import Quality

EFFORTS: tuple[Quality, ...] = ("best", "fast")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    jobs = parser.add_subparsers(dest="job", required=True)
    scenes_parser, speed_parser, confidence_parser = (
        jobs.add_parser(name) for name in ("scenes", "speed", "confidence")
    )
    scenes_parser.add_argument("scenes", nargs="+", metavar="SCENE[=TRUTH.pfm]")
    scenes_parser.add_argument("--every", type=int, default=1, help="use every Nth view of a complete scene")
    scenes_parser.add_argument("--step", type=int, help="steps of the full grid between views, if some are absent")
    scenes_parser.add_argument("--fast", action="store_true")
    speed_parser.add_argument("--rounds", type=int, default=10)
    confidence_parser.add_argument("--train", nargs="+", default=[], metavar="SCENE[=TRUTH.pfm]")
    confidence_parser.add_argument("--test", nargs="+", default=[], metavar="SCENE[=TRUTH.pfm]")
    confidence_parser.add_argument("--step", type=int, default=4, help="steps of the full grid between views")
    confidence_parser.add_argument("--figure", type=Path, help="SVG file of the reliability diagrams to write")
    confidence_parser.add_argument("--fast", action="store_true", help="test the fast quality; both are trained")
    for job in (scenes_parser, speed_parser, confidence_parser):
        add_json_option(job)
    options = parser.parse_args()
    quality: Quality = "fast" if getattr(options, "fast", False) else "best"
    if options.job == "speed":
        write_record(options.json, "light_field_depth_speed", table=speed(options.rounds).table)
    elif options.job == "confidence":
        if options.train:
            training = cases(options.train, options.step, TRAINING_SEED)
            store(train(tried(case, effort) for case in training for effort in EFFORTS))
        results = (tried(case, quality) for case in cases(options.test, options.step, TEST_SEED))
        write_record(options.json, "light_field_depth_confidence", table=report(results, options.figure).table)
    else:
        rows = print_scores(options.scenes, options.every, options.step, quality)
        write_record(options.json, "light_field_depth_scenes", table=rows.table)


if __name__ == "__main__":
    main()
