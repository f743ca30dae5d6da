#!/usr/bin/env bash
# Runs a program on a display in memory: window_picture.sh PROGRAM ARGUMENTS... For the pictures of
# windows in the README; needs Xvfb.
set -euo pipefail

exec {number_of}<> <(:)  # a pipe that Xvfb writes the number of its display into
Xvfb -displayfd "$number_of" -screen 0 1600x1000x24 -nolisten tcp 2>/dev/null &
server=$!
trap 'kill "$server" 2>/dev/null || true' EXIT
read -r -t 15 -u "$number_of" number || { echo "window_picture.sh: Xvfb does not start" >&2; exit 3; }
DISPLAY=:$number "$@"
