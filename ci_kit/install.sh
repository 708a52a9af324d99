#!/usr/bin/env bash
# Install what renders and scores calibration sets into a virtual environment: files with the hashes of requirements.lock
# alone, and this program, which is built by one of them.
# Usage: ci_kit/install.sh FOLDER        PYTHON=/path/to/python chooses the interpreter.
set -euo pipefail
folder=${1:?usage: ci_kit/install.sh FOLDER}
source=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)

"${PYTHON:-python3}" -m venv "$folder"
pip() { "$folder/bin/python" -m pip install --quiet --disable-pip-version-check "$@"; }
pip --require-hashes -r "$source/ci_kit/requirements.lock"
pip --no-deps --no-build-isolation "$source"
"$folder/bin/python" -c "from importlib.metadata import version; import mirrorcam.cli; print('mirrorcam', version('mirrorcam'))"
