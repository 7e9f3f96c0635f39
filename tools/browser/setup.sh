# shellcheck shell=bash
# Sourced by the checks that need a browser; the caller has sourced apt.sh and defines fail MESSAGE. npm_packages needs neither.

BROWSER_CACHE=${XDG_CACHE_HOME:-$HOME/.cache}/instgs-vk

# Prints the program to check: the argument, or the newest that cargo has built, of whichever profile: an older one would be
# checked in place of what has just been changed. It says which.
find_program() {
  local target=${CARGO_TARGET_DIR:-$HERE/../target} profile program newest=
  if [ -n "$1" ]; then
    printf '%s\n' "$1"
    return
  fi
  for profile in demo release debug; do
    program=$target/$profile/instgs-vk
    if [ -x "$program" ] && { [ -z "$newest" ] || [ "$program" -nt "$newest" ]; }; then
      newest=$program
    fi
  done
  [ -n "$newest" ] || fail "no instgs-vk in $target; build it, or give its path"
  printf 'tools/%s: with %s\n' "${0##*/}" "$newest" >&2
  printf '%s\n' "$newest"
}

# npm_packages FOLDER PACKAGE@VERSION ...: installs the packages into the cache's folder unless it has them.
npm_packages() {
  local folder=$BROWSER_CACHE/$1
  shift
  if [ -e "$folder/complete" ]; then
    return
  fi
  rm -rf "$folder"
  mkdir -p "$folder"
  npm install --silent --no-fund --no-audit --prefix "$folder" "$@" || return
  touch "$folder/complete"
}

# Chromium of the system, driven by playwright-core. browser.cjs starts the one that CHROMIUM names.
PLAYWRIGHT=playwright-core-1.65.1
install_browser() {
  if ! command -v chromium >/dev/null; then
    apt_install chromium
  fi
  CHROMIUM=$(command -v chromium) || return
  export CHROMIUM
  npm_packages "$PLAYWRIGHT" "${PLAYWRIGHT%-*}@${PLAYWRIGHT##*-}"
}
