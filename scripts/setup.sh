#!/usr/bin/env bash
# Makes .venv from requirements.lock, and installs the system libraries that open3d and off-screen rendering need
# (when permitted; otherwise one line says what to install). Does nothing when everything is already in place.
#
# `scripts/setup.sh robot` makes .venv-robot from requirements-robot.lock instead: what the robot's own computer needs,
# without twin, pictures and learned models.
set -euo pipefail
cd "$(dirname "$0")/.."

UV_VERSION=0.13.9
case "${1:-all}" in
all) venv=.venv lock=requirements.lock ;;
robot) venv=.venv-robot lock=requirements-robot.lock ;;
*)
    printf 'setup: there is no part %s; there are: all, robot\n' "$1" >&2
    exit 2
    ;;
esac
stamp=$venv/.replan-setup
want=$(cat "$lock" pyproject.toml replan_base/__init__.py scripts/setup.sh | sha256sum | cut -d' ' -f1)
if [ -x "$venv/bin/replan" ] && [ "$(cat "$stamp" 2>/dev/null)" = "$want" ]; then exit 0; fi

say() { printf 'setup: %s\n' "$*" >&2; }
fail() { say "$*"; exit 1; }

# Runs apt-get as root, or not at all: never asks for a password.
apt_install() {
    command -v apt-get >/dev/null || return 1
    local as_root=()
    if [ "$(id -u)" != 0 ]; then
        command -v sudo >/dev/null && sudo -n true 2>/dev/null || return 1
        as_root=(sudo -n)
    fi
    say "installing system packages: $*"
    "${as_root[@]}" apt-get update -qq >&2 || true
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@" >/dev/null
}

need_packages() { # need_packages WHY PACKAGE...
    local why=$1
    shift
    apt_install "$@" || fail "$why; please run: sudo apt-get install $*"
}

# --- Python ---------------------------------------------------------------------------------------------------------
python=
for candidate in python3 python3.13 python3.12 python3.11; do
    if command -v "$candidate" >/dev/null &&
        "$candidate" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null; then
        python=$(command -v "$candidate")
        break
    fi
done
[ -n "$python" ] || fail "Python 3.11, 3.12 or 3.13 is needed; please run: sudo apt-get install python3 python3-venv"

# --- System libraries -----------------------------------------------------------------------------------------------
missing=()
if [ "$venv" = .venv ]; then
    has_library() { ldconfig -p 2>/dev/null | grep -q "$1" || /sbin/ldconfig -p 2>/dev/null | grep -q "$1"; }
    has_library 'libEGL\.so\.1' || missing+=(libegl1)
    has_library 'libGL\.so\.1' || missing+=(libgl1)
    has_library 'libgomp\.so\.1' || missing+=(libgomp1)
    has_library 'libusb-1\.0\.so\.0' || missing+=(libusb-1.0-0)
    # Software rendering: Mesa's drivers are opened by path, not through the linker's cache.
    if ! compgen -G '/usr/lib/*/dri/swrast_dri.so' >/dev/null && ! compgen -G '/usr/lib/*/libgallium*.so' >/dev/null &&
        [ ! -e /dev/nvidia0 ]; then missing+=(libgl1-mesa-dri); fi
fi
if [ ${#missing[@]} -gt 0 ]; then
    need_packages "system libraries for rendering and point clouds are missing" "${missing[@]}"
fi

# --- Environment ----------------------------------------------------------------------------------------------------
export UV_PYTHON_DOWNLOADS=never UV_NO_CONFIG=1
if [ "$(.tools/bin/uv --version 2>/dev/null | cut -d' ' -f2)" != "$UV_VERSION" ]; then
    say "installing uv $UV_VERSION into .tools"
    rm -rf .tools
    if ! "$python" -m venv .tools >/dev/null 2>&1; then
        need_packages "Python's venv module is missing" python3-venv
        rm -rf .tools
        "$python" -m venv .tools
    fi
    .tools/bin/pip install --quiet --disable-pip-version-check "uv==$UV_VERSION"
fi
if [ ! -x "$venv/bin/python" ]; then
    say "making $venv with $("$python" --version)"
    .tools/bin/uv venv --quiet --python "$python" "$venv"
fi
if [ "$venv" = .venv ]; then
    say "installing the locked packages (about 8 GB on disk, most of it CUDA libraries that come with torch)"
else
    say "installing the locked packages (about 1 GB on disk, most of it robot descriptions and Pinocchio)"
fi
.tools/bin/uv pip sync --quiet --python "$venv/bin/python" --require-hashes "$lock"
# What builds this package is locked too; the robot's environment does without it afterwards.
if [ "$venv" = .venv ]; then build=(--no-build-isolation); else build=(--build-constraints requirements.lock); fi
.tools/bin/uv pip install --quiet --python "$venv/bin/python" --no-deps "${build[@]}" --editable .
# Byte-compile now, so that the first command is neither slow nor prints the warnings of somebody else's docstrings.
"$venv/bin/python" -W ignore -m compileall -q benchmarks perception control hw_interface sim_check planning prompts \
    replan replan_base || true
for noisy in "$venv"/lib/python*/site-packages/toppra; do
    if [ -d "$noisy" ]; then "$venv/bin/python" -W ignore -m compileall -q "$noisy" || true; fi
done
printf '%s' "$want" >"$stamp"
say "done; the command is $venv/bin/replan"
