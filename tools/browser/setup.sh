# shellcheck shell=bash
# Sourced by the checks that need a browser; the caller has sourced apt.sh and defines fail MESSAGE.

BROWSER_CACHE=${XDG_CACHE_HOME:-$HOME/.cache}/instgs-vk

# Prints the program to check: the argument, or the one of cargo's profile that is built, the quickest first.
find_program() {
  local target=${CARGO_TARGET_DIR:-$HERE/../target} profile
  if [ -n "$1" ]; then
    printf '%s\n' "$1"
    return
  fi
  for profile in demo release debug; do
    if [ -x "$target/$profile/instgs-vk" ]; then
      printf '%s\n' "$target/$profile/instgs-vk"
      return
    fi
  done
  fail "no instgs-vk in $target; build it, or give its path"
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

# Chromium of the system, driven by playwright-core.
PLAYWRIGHT=playwright-core-1.65.1
install_browser() {
  if ! command -v chromium >/dev/null; then
    apt_install chromium
  fi
  npm_packages "$PLAYWRIGHT" "${PLAYWRIGHT%-*}@${PLAYWRIGHT##*-}"
}
