#!/usr/bin/env bash
# Sets up the workspace: system packages, virtual environment, locked dependencies, colcon build,
# the planner's console scripts, warm compiled code. Each stage that has succeeded leaves a stamp
# with the hash of what it depended on, so a second run does nothing, an interrupted one goes on
# where it stopped, and a changed lock or message file redoes what follows from it.
#
#   scripts/setup.sh [LAST_STAGE]
set -euo pipefail
cd "$(dirname "$0")/.."

root=$PWD
last_stage=${1:-}
venv=$root/.venv
stamps=$venv/stamps
planner=ros2_ws/src/gpis_grasp_planner

# Two set-ups of one workspace at a time would trample on each other.
if command -v flock >/dev/null; then
    exec 9<"$0"
    flock 9
fi

# key FILE_OR_DIRECTORY... -> one hash over names and contents, and the place of the workspace
# (virtual environments and colcon installations cannot be moved).
key() {
    {
        echo "$root"
        find "$@" -type f ! -path '*/__pycache__/*' ! -path '*.egg-info/*' -print0 \
            | LC_ALL=C sort -z | xargs -0 -r sha256sum
    } | sha256sum | cut -d ' ' -f 1
}

# stage NAME KEY COMMAND...: run the command unless it has succeeded with this very key.
stage() {
    local name=$1 key=$2 start=$SECONDS
    shift 2
    if [ "$(cat "$stamps/$name" 2>/dev/null)" != "$key" ]; then
        echo "== $name"
        rm -f "$stamps/$name"
        "$@"
        mkdir -p "$stamps"
        echo "$key" >"$stamps/$name"
        echo "== $name: done in $((SECONDS - start)) s"
    fi
    [ "$name" != "$last_stage" ] || exit 0
}

virtual_environment() {
    scripts/system_packages.sh
    # One that works is kept, with what it holds; a half-made or moved one is made anew.
    "$venv/bin/python" -m pip --version 2>/dev/null | grep -q '(python 3\.11)' \
        && grep -qF "$venv/bin/" "$venv/bin/pip" && return
    rm -rf "$venv" ros2_ws/{build,install,log}
    "$(scripts/system_packages.sh --python)" -m venv "$venv"
}

dependencies() {
    # Killed in the middle, it may have left packages that look installed and are half there.
    local begun=$stamps/dependencies.begun settings anew=() anew_uv=() quiet=(-q)
    [ ! -e "$begun" ] || { anew=(--force-reinstall) anew_uv=(--reinstall); }
    [ ! -t 2 ] || quiet=()
    mkdir -p "$stamps"
    touch "$begun"

    echo "Some 240 packages, 2.6 GB when installed; the first time they have to be downloaded."
    "$venv/bin/python" -m pip install -q --disable-pip-version-check --require-hashes \
        "${anew[@]}" -r requirements/installer.lock
    settings=$("$venv/bin/python" scripts/uv_settings.py)
    # The few source distributions are built with the locked setuptools, too.
    (
        eval "$settings"
        "$venv/bin/uv" pip install "${quiet[@]}" --python "$venv/bin/python" --require-hashes \
            "${anew_uv[@]}" --build-constraints requirements/requirements.lock \
            -r requirements/requirements.lock
    )
    # uv leaves this to the first import, and where PYTHONDONTWRITEBYTECODE is set to every one: a
    # plan's imports would take three times as long. Templates that are no Python are passed over.
    "$venv/bin/python" -m compileall -qq -j 0 "$venv/lib/python3.11/site-packages" || true
    rm "$begun"
}

workspace() {
    # env.sh would put an older build of this workspace under the new one.
    (
        export VIRTUAL_ENV=$venv PATH=$venv/bin:$PATH
        export AMENT_PREFIX_PATH=$venv CMAKE_PREFIX_PATH=$venv
        cd ros2_ws
        # Standard messages that the ROS wheels lack; a system installation has the real ones.
        stand_ins=()
        for package in stand_ins/*/; do
            [ -e "$venv/share/$(basename "$package")/package.xml" ] || stand_ins+=("$package")
        done
        colcon --log-level error build --symlink-install --base-paths src \
            --paths "${stand_ins[@]}" --cmake-args -DBUILD_TESTING=OFF -DPython3_EXECUTABLE="$venv/bin/python"
    )
}

console_scripts() {
    "$venv/bin/uv" pip install -q --python "$venv/bin/python" --offline --no-deps \
        --no-build-isolation -e "$planner" -e ./benchmark
}

warm_up() {
    "$venv/bin/python" -m compileall -qq "$planner/gpis_grasp_planner"
    "$venv/bin/python" -m gpis_grasp_planner.plan.warm_up
}

stage virtual_environment "$(key scripts/system_packages.sh)" virtual_environment
stage dependencies "$(key requirements/*.lock)" dependencies
stage workspace "$(key requirements/*.lock ros2_ws/src/*msgs ros2_ws/stand_ins "$planner"/{setup.*,package.xml,resource} \
    "$planner"/gpis_grasp_planner/hand/models)" workspace
stage console_scripts "$(key requirements/*.lock "$planner"/setup.* benchmark/pyproject.toml)" console_scripts
# Compiled functions are kept in a folder for this very state of the sources.
compiled_sources() {
    PYTHONPATH=$planner "$venv/bin/python" -c \
        'from gpis_grasp_planner.compiled_cache import sources_hash; print(sources_hash())'
}
stage warm_up "$(compiled_sources)" warm_up
