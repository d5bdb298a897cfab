#!/bin/sh
# Prints the newest usable CPython between LOWEST and HIGHEST on PATH or among pyenv's versions.
#
#     tools/find_python.sh [LOWEST [HIGHEST]]      default 3.11 3.14; LOWEST alone: that one only
#
# Usable means that it runs (a pyenv shim of a version that is not selected does not), can make
# virtual environments, and can load binary wheels from them. Newest, because newer drakes are
# several times faster, and pip gives older Pythons older drakes.
set -u
lowest=${1:-3.11}
highest=${2:-${1:-3.14}}

# Prints "usable NUMBER EXECUTABLE", or "lacks MODULE EXECUTABLE" if that is all that is wrong.
# It is given to `python -c`, and must be harmless to a Python 2.
probe='
import sys
lowest, highest = (tuple(map(int, a.split("."))) for a in sys.argv[1:])
version = sys.version_info
if not lowest <= version[:2] <= highest or version[3] != "final":
    sys.exit(1)
import sysconfig
if sys.implementation.name != "cpython" or sysconfig.get_config_var("Py_GIL_DISABLED"):
    sys.exit(1)
for module in "ensurepip", "venv", "ctypes", "ssl", "zlib":
    try:
        __import__(module)
    except ImportError:
        print("lacks %s %s" % (module, sys.executable))
        sys.exit(1)
print("usable %d%03d%03d %s" % (tuple(version[:3]) + (sys.executable,)))
'

# Executables that may be Pythons, one a line, PATH first.
candidates() {
    (
        IFS=:
        for folder in $PATH; do
            for name in python3.14 python3.13 python3.12 python3.11 python3 python; do
                echo "${folder:-.}/$name"
            done
        done
    )
    for root in "${PYENV_ROOT:-}" "${HOME:-}/.pyenv"; do
        for file in "$root"/versions/*/bin/python3; do
            echo "$file"
        done
    done
}

best=0
chosen=
lacking=
while IFS= read -r candidate; do
    [ -x "$candidate" ] || continue
    found=$("$candidate" -I -c "$probe" "$lowest" "$highest" 2>/dev/null </dev/null)
    case $found in
    "usable "*)
        found=${found#usable }
        if [ "${found%% *}" -gt "$best" ]; then
            best=${found%% *}
            chosen=${found#* }
        fi
        ;;
    "lacks "*) lacking=${lacking:-${found#lacks }} ;;
    esac
done <<EOF
$(candidates)
EOF

if [ -n "$chosen" ]; then
    echo "$chosen"
    exit 0
fi
wanted=$lowest
[ "$lowest" = "$highest" ] || wanted="$lowest to $highest"
echo "No usable Python $wanted on PATH or among pyenv's versions." >&2
if [ -n "$lacking" ]; then
    echo "${lacking#* } lacks the module ${lacking%% *} (Debian, Ubuntu: apt install python3-venv)." >&2
fi
exit 1
