#!/usr/bin/env bash
# Try a calibrator on rendered sets with known truth: render a suite, run a command on each of its sets, score the results.
# action.yml and gitlab.yml run this script; it runs the same on a laptop:
#
#   COMMAND='python calibrate.py' ci_kit/evaluate.sh
#
# Settings, all of the environment:
#   COMMAND   what calibrates one set: it reads the folder $MIRRORCAM_SET and writes into the folder $MIRRORCAM_RESULT
#   SUITE     name of a suite, or a TOML file (smoke)
#   SUITES    folder for the rendered sets, kept between runs (mirrorcam-suites)
#   WORKERS   sets rendered at the same time (all cores)
#   OUT       folder for what is found: evaluation.json, summary.md, junit.xml, pictures, results (mirrorcam-evaluation)
#   FORMAT    format of the calibrations (as their content states)
#   LIMITS    TOML file of limits; BASELINE  evaluation.json of an earlier run; WORSE_BY  factor of RMS that is allowed
#   TIMEOUT_S seconds that the command may take on one set (600)
#   SUMMARY   file to which the summary is appended; on GitHub, that of the job
#   MIRRORCAM the program (mirrorcam)
#   SETTINGS  further options of mirrorcam score suite
# Exit code: 0 passed, 1 past a limit or a set without a result, 2 a setting or file is wrong.
set -euo pipefail

: "${COMMAND:?expected the command that calibrates one set, such as COMMAND='python calibrate.py'}"
suites=${SUITES:-mirrorcam-suites}
out=${OUT:-mirrorcam-evaluation}
mirrorcam=${MIRRORCAM:-mirrorcam}
summary=${SUMMARY:-${GITHUB_STEP_SUMMARY:-}}

"$mirrorcam" suite "${SUITE:-smoke}" --out "$suites" ${WORKERS:+--workers "$WORKERS"}

# The folder may hold other suites from earlier runs: the manifest of this one was written last.
# shellcheck disable=SC2012 # names of manifests are plain
manifest=$(ls -t "$suites"/*.suite.json 2>/dev/null | head -n 1 || true)

code=0
# shellcheck disable=SC2086 # SETTINGS holds several options
"$mirrorcam" score suite "${manifest:-$suites}" --command "$COMMAND" --out "$out" \
    --timeout-s "${TIMEOUT_S:-600}" --force ${FORMAT:+--format "$FORMAT"} \
    ${LIMITS:+--limits "$LIMITS"} ${BASELINE:+--baseline "$BASELINE"} ${WORSE_BY:+--worse-by "$WORSE_BY"} \
    ${SETTINGS:-} || code=$?
if [ -n "$summary" ] && [ "$code" -lt 2 ]; then
    # A summary of a job shows no files of the job: the pictures are beside summary.md.
    grep -v '^!\[' "$out/summary.md" >> "$summary"
fi
exit "$code"
