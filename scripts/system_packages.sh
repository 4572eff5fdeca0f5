#!/usr/bin/env bash
# Looks for what must come from the system (not from Python wheels) and installs what is missing
# where that is possible: Debian-like, and root or sudo. Elsewhere it says what to install and stops.
#
#   scripts/system_packages.sh           check, install what is missing
#   scripts/system_packages.sh --check   check only
#   scripts/system_packages.sh --browser the same for what only the viewer's tests need
#   scripts/system_packages.sh --python  print the CPython 3.11 that will be used
set -euo pipefail

# The wheels (rclpy and PyBullet foremost) exist for CPython 3.11.
find_python() {
    local candidate
    for candidate in python3.11 python3 python; do
        command -v "$candidate" >/dev/null || continue
        "$candidate" - <<'PY' 2>/dev/null && return 0
import sys
if sys.implementation.name != "cpython" or sys.version_info[:2] != (3, 11):
    raise SystemExit(1)
print(getattr(sys, "_base_executable", sys.executable))
PY
    done
    return 1
}

has_library() {
    "$python" -c 'import ctypes, sys; ctypes.CDLL(sys.argv[1])' "$1" 2>/dev/null
}

has_headers() {
    "$python" -c 'import os, sysconfig
raise SystemExit(not os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h")))'
}

# Fills `missing` with "what it is for|Debian package" lines.
look() {
    missing=()
    python=$(find_python) || python=""
    if [ -z "$python" ]; then
        missing+=("CPython 3.11 (found as python3.11 or python3)|python3.11")
        missing+=("its module venv|python3.11-venv")
        missing+=("its headers|libpython3.11-dev")
    else
        "$python" -c 'import ensurepip, venv' 2>/dev/null \
            || missing+=("the module venv of $python|python3.11-venv")
        has_headers || missing+=("the headers of $python|libpython3.11-dev")
    fi
    command -v make >/dev/null || missing+=("make|make")
    command -v cmake >/dev/null || missing+=("CMake|cmake")
    command -v c++ >/dev/null || missing+=("a C++ compiler (c++)|g++")
    local library
    for library in libEGL.so.1=libegl1 libGL.so.1=libgl1 libusb-1.0.so.0=libusb-1.0-0; do
        if [ -n "$python" ]; then has_library "${library%%=*}" && continue; fi
        missing+=("${library%%=*} (needed by Open3D)|${library##*=}")
    done
    if command -v dpkg >/dev/null && [ ! -e /etc/ssl/certs/ca-certificates.crt ]; then
        missing+=("certificates for downloads|ca-certificates")
    fi
}

report() {
    echo "Missing on this machine:"
    printf '  - %s\n' "${missing[@]%%|*}"
}

stop() {
    {
        report
        echo
        echo "$1"
        echo "On Debian 12:   apt-get install --no-install-recommends ${missing[*]##*|}"
        echo "Elsewhere: the packages that provide the above. Then run the same make command again."
    } >&2
    exit 2
}

install() {
    local packages=("${missing[@]##*|}") as_root=()
    command -v apt-get >/dev/null || stop "This is no Debian-like system: please install them yourself."
    if [ "$(id -u)" -ne 0 ]; then
        command -v sudo >/dev/null || stop "Installing needs root, and there is no sudo: please have them installed."
        if ! sudo -n true 2>/dev/null && [ ! -t 0 ]; then
            stop "Installing needs root; sudo asks for a password and nobody is there to type it."
        fi
        as_root=(sudo)
    fi
    report
    echo "Installing: ${packages[*]}"
    "${as_root[@]}" apt-get update -q
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
        apt-get install -q -y --no-install-recommends "${packages[@]}" \
        || stop "apt-get could not install them (its message is above)."
}

case "${1:-}" in
--browser)
    missing=()
    if ! command -v chromium >/dev/null && ! command -v google-chrome >/dev/null; then
        missing+=("Chromium (tests of the viewer)|chromium")
        install
    fi
    ;;
--python)
    find_python
    ;;
--check | "")
    look
    if [ ${#missing[@]} -gt 0 ]; then
        [ -z "${1:-}" ] || stop "Please install them."
        install
        look
        [ ${#missing[@]} -eq 0 ] || stop "apt-get succeeded, and yet these are not found."
    fi
    ;;
*)
    sed -n '2,8s/^# \{0,1\}//p' "$0" >&2
    exit 64
    ;;
esac
