# shellcheck shell=bash
# Sourced by the scripts: runs a stage, prints its name before and its duration after.

STAGES_DONE=0
START_SECONDS=$SECONDS

stage() {
  local name=$1 begin=$SECONDS
  shift
  printf '== %s\n' "$name"
  local code=0
  "$@" || code=$?
  if [ "$code" -ne 0 ]; then
    printf '== FAILED: %s (exit code %d, after %d s)\n' "$name" "$code" "$((SECONDS - begin))" >&2
    exit 1
  fi
  STAGES_DONE=$((STAGES_DONE + 1))
  printf '== %s: %d s\n' "$name" "$((SECONDS - begin))"
}

total_seconds() {
  echo "$((SECONDS - START_SECONDS))"
}
