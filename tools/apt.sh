# shellcheck shell=bash
# Sourced by the set-up scripts; the caller defines fail MESSAGE, which ends the script.

# Installs its arguments with apt, or says in one line what a person has to install.
apt_install() {
  local as_root=()
  if [ "$(id -u)" -ne 0 ]; then
    if ! sudo -n true 2>/dev/null; then
      fail "please install: $*  (for instance: sudo apt-get install $*), then run this again"
    fi
    as_root=(sudo -n)
  fi
  printf 'tools/%s: installing %s\n' "${0##*/}" "$*"
  local options=(-y -q --no-install-recommends)
  if ! "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install "${options[@]}" "$@" >/dev/null 2>&1; then
    # The package lists may be old or empty.
    "${as_root[@]}" apt-get update -q >/dev/null || fail "apt-get update failed; please install: $*"
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install "${options[@]}" "$@" >/dev/null ||
      fail "apt-get could not install: $*"
  fi
}
