#!/usr/bin/env bash
# Install what renders and scores calibration sets, in the versions that were tested, into a virtual environment.
# Usage: ci_kit/install.sh FOLDER        PYTHON=/path/to/python chooses the interpreter.
set -euo pipefail
folder=${1:?usage: ci_kit/install.sh FOLDER}
source=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)

"${PYTHON:-python3}" -m venv "$folder"
"$folder/bin/python" -m pip install --quiet --disable-pip-version-check -c "$source/constraints.txt" "$source[render,cluster]"
"$folder/bin/python" -c "from importlib.metadata import version; import mirrorcam.cli; print('mirrorcam', version('mirrorcam'))"
