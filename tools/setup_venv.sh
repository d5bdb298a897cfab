#!/bin/sh
# Makes or refreshes the virtual environment VENV with pips-drake[EXTRA], editable; run at the top
# of the repository.
#
#     tools/setup_venv.sh VENV EXTRA [PYTHON]      PYTHON: default the newest usable one
#
# VENV/.installed-EXTRA is written last. VENV/.incomplete is there from before the first file until
# then: an environment with that mark was interrupted, and is made anew.
set -eu
venv=$1
extra=$2
python=${3:-}
tools=$(dirname "$0")

works() {
    [ ! -e "$venv/.incomplete" ] && "$venv/bin/python" -c 'import pip' 2>/dev/null
}

if ! works; then
    if [ -e "$venv" ] && [ ! -e "$venv/.incomplete" ] && [ ! -e "$venv/pyvenv.cfg" ]; then
        echo "$venv is there, and is no virtual environment: move it away." >&2
        exit 1
    fi
    [ -n "$python" ] || python=$(sh "$tools/find_python.sh")
    echo "Making $venv with $("$python" --version)."
    rm -rf "$venv"
    mkdir "$venv"
    : >"$venv/.incomplete"
    "$python" -m venv "$venv"
fi

# Extras that are there already are installed again with the new one, so that all have the versions
# that pyproject.toml now asks for.
extras=$extra
for stamp in "$venv"/.installed-*; do
    if [ -e "$stamp" ] && [ "${stamp##*-}" != "$extra" ]; then extras=$extras,${stamp##*-}; fi
done
: >"$venv/.incomplete"
rm -f "$venv"/.installed-*
echo "Installing pips-drake[$extras]; the first time this takes some minutes."
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check --editable ".[$extras]"
rm -f "$venv/.incomplete"
for extra in $(echo "$extras" | tr , ' '); do
    : >"$venv/.installed-$extra"
done
