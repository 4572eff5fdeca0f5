#!/usr/bin/env bash
# Runs a command in the workspace's environment.
set -euo pipefail
source "$(dirname "$0")/../scripts/env.sh"
exec "$@"
