#!/bin/sh
# Checks for the system's libraries that Drake's wheel loads but does not carry.
#
#     tools/system_libraries.sh PYTHON      PYTHON: one that has pips-drake
#
# Missing ones are installed with apt where that is possible (as root); otherwise one line names the
# packages. Without libglib2.0-0 Drake cannot be imported, and the exit status is 1; without software
# EGL only rendered pictures are missing, and it is 0.
set -u
python=$1
[ "$(uname -s)" = Linux ] || exit 0 # elsewhere Drake's wheel brings all that it needs

has_glib() {
    "$python" -c 'import ctypes; ctypes.CDLL("libglib-2.0.so.0")' 2>/dev/null
}

has_egl() {
    "$python" -c 'import sys; from pips_drake.scene import rendering; sys.exit(not rendering.can_render())' \
        2>/dev/null
}

apt_install() {
    [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null || return 1
    echo "Installing $* with apt."
    {
        apt-get update && DEBIAN_FRONTEND=noninteractive \
            apt-get install --yes --no-install-recommends "$@"
    } >/dev/null 2>&1
}

if ! has_glib; then
    apt_install libglib2.0-0
    if ! has_glib; then
        echo "Drake needs the library libglib-2.0.so.0 (Debian, Ubuntu: apt install libglib2.0-0)." >&2
        exit 1
    fi
fi
if ! has_egl; then
    apt_install libegl1 libgl1-mesa-dri
    if ! has_egl; then
        echo "No rendered pictures: software EGL is missing (Debian, Ubuntu:" \
            "apt install libegl1 libgl1-mesa-dri). Everything else works." >&2
    fi
fi
