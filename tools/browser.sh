#!/bin/sh
# Checks for the browser that the slow tests open replays with: the system's `chromium`.
#
#     tools/browser.sh
#
# A missing one is installed with apt where that is possible (as root); otherwise one line says that
# those tests are skipped. The exit status is 0 in any case.
set -u

has_browser() {
    command -v chromium >/dev/null
}

has_browser && exit 0
if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    echo "Installing chromium with apt."
    {
        apt-get update && DEBIAN_FRONTEND=noninteractive \
            apt-get install --yes --no-install-recommends chromium
    } >/dev/null 2>&1
fi
has_browser || echo "No chromium: the tests that open replays in a browser are skipped." >&2
exit 0
