# Sourced by scripts that need a bare Debian or Ubuntu, as root.

# make_system SUITE FOLDER [MIRROR]: by debootstrap, from where this machine takes its own packages, an
# Ubuntu from debootstrap's own default, unless a mirror is named. One that is in $RAYLIFT_BARE_SYSTEMS
# is copied.
make_system() {
  local suite=$1 folder=$2 mirror=${3:-} own components=main
  if [ -n "${RAYLIFT_BARE_SYSTEMS:-}" ] && [ -d "$RAYLIFT_BARE_SYSTEMS/$suite" ]; then
    cp --archive "$RAYLIFT_BARE_SYSTEMS/$suite/." "$folder"
    return
  fi
  if grep --quiet ubuntu-archive-keyring "/usr/share/debootstrap/scripts/$suite"; then
    components=main,universe
  elif [ -z "$mirror" ]; then
    own=$(. /etc/os-release && echo "$VERSION_CODENAME")
    mirror=$(apt-get indextargets --format '$(SITE)' 'Created-By: Packages' "Codename: $own" | head -n 1)
  fi
  eval "$(apt-config shell http_proxy Acquire::http::Proxy https_proxy Acquire::https::Proxy)"
  export http_proxy https_proxy
  debootstrap --variant=minbase --include=ca-certificates --components="$components" "$suite" "$folder" ${mirror:+"$mirror"}
  apt-config dump | grep -E '^Acquire::[a-z]+::[Pp]roxy' > "$folder/etc/apt/apt.conf.d/90host" || true
  cp /etc/resolv.conf /etc/hosts "$folder/etc/"
}

# inside FOLDER COMMAND: runs it there as a new machine would, with its own processes and mounts.
inside() {
  local folder=$1 command=$2
  unshare --mount --pid --fork bash -c '
    mount -t proc proc "$0/proc" && mount -t tmpfs tmpfs "$0/dev/shm" &&
    exec chroot "$0" env --ignore-environment PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root \
      LANG=C.UTF-8 DEBIAN_FRONTEND=noninteractive bash -euo pipefail -c "$1"' "$folder" "$command"
}
