#!/bin/sh
# tests/fresh.sh [--keep] [--in FOLDER] [COMMAND]: does this commit work on a fresh Debian 12?
#
# Builds a minimal Debian 12 with debootstrap in a temporary folder, adds git and make and nothing else, copies a clone
# of HEAD in, and runs "make run", then "make check" there as root, with this machine's apt sources and an empty
# environment. COMMAND replaces the two. Mounts are private to the test and go with it; the folder is removed
# (--keep keeps it; --in says where to put it, default /var/tmp).
# Exit 0: it works; 1: it does not; 2: wrong usage; 77: it cannot be tried here, with the reason. Needs root, 3 GB.
set -u
release=bookworm
keep=0 in=/var/tmp
while [ $# -gt 0 ]; do
	case $1 in
	--keep) keep=1 ;;
	--in) shift; in=${1-} ;;
	-*) echo "usage: $0 [--keep] [--in FOLDER] [COMMAND]" >&2; exit 2 ;;
	*) break ;;
	esac
	shift
done
[ -d "$in" ] || { echo "fresh: '$in' is no folder" >&2; exit 2; }
cd "$(dirname "$0")/.." || exit 2

skip() { echo "fresh: skipped: $1"; exit 77; }
[ "$(id -u)" = 0 ] || skip "debootstrap and chroot need root"
for tool in debootstrap unshare chroot git; do
	command -v $tool >/dev/null 2>&1 || skip "$tool is not installed (package $([ $tool = unshare ] && echo util-linux || echo $tool))"
done
unshare --mount --pid --fork true 2>/dev/null || skip "no new mount and process namespaces here"
[ "$(df -Pk "$in" | awk 'NR == 2 { print $4 }')" -gt 3000000 ] || skip "less than 3 GB free in $in"
findmnt -n -o OPTIONS -T "$in" 2>/dev/null | grep -qE '(^|,)(nodev|noexec)(,|$)' && skip "$in is mounted nodev or noexec"

# The first Debian archive of this machine's apt sources, of either format.
sources=$(find /etc/apt/sources.list /etc/apt/sources.list.d -type f \( -name '*.list' -o -name '*.sources' \) 2>/dev/null)
mirror=$(cat $sources /dev/null | sed -nE 's/^(deb( +\[[^]]*\])?|URIs:) +(https?:[^ ]*\/debian)\/?( .*)?$/\3/p' | head -n 1)
[ -n "$mirror" ] || skip "the apt sources name no Debian archive by http"

root=$(mktemp -d "$in/blackburst-fresh.XXXXXX") || exit 1
chmod 755 "$root" # it is "/" in there: apt's own user must get through
child=
clean() {
	[ -n "$child" ] && kill -KILL "-$child" 2>/dev/null && wait "$child" 2>/dev/null
	rm -f "$root.log"
	# What debootstrap mounted and could not unmount; deepest first.
	awk -v r="$root/" 'index($2, r) == 1 { print $2 }' /proc/mounts | sort -r | while read -r m; do umount "$m"; done
	if grep -q " $root/" /proc/mounts; then
		echo "fresh: something is still mounted below $root; not removed" >&2
	elif [ $keep = 1 ]; then
		echo "fresh: kept $root"
	else
		rm -rf --one-file-system "$root"
	fi
}
trap clean EXIT
trap 'exit 1' HUP INT TERM

/usr/lib/apt/apt-helper download-file "$mirror/dists/$release/Release" "$root/Release" >/dev/null 2>&1 ||
	skip "$mirror does not answer"
rm -f "$root/Release"

begin_s=$(date +%s)
lap() { now_s=$(date +%s); echo "fresh: $1: $((now_s - begin_s)) s"; begin_s=$now_s; }

packages=git,make
case $mirror in https:*) packages=$packages,ca-certificates ;; esac
# setsid and wait, here and below, so that a signal reaches us at once and the trap can end the child.
setsid debootstrap --variant=minbase --include=$packages "$release" "$root" "$mirror" >"$root.log" 2>&1 </dev/null &
child=$!
wait $child; status=$?; child=
if [ $status != 0 ]; then
	tail -n 20 "$root.log"
	echo "fresh: debootstrap failed"; exit 1
fi
rm -f "$root.log"
lap "a minimal Debian with $packages"

# This machine's ways to the network and its Debian sources (not those of third parties).
cp -L /etc/resolv.conf /etc/hosts "$root/etc/" 2>/dev/null
rm -f "$root/etc/apt/sources.list"
mkdir -p "$root/etc/apt/sources.list.d" "$root/usr/share/keyrings"
for f in $sources; do
	grep -qE '^[^#]*https?:.*/debian' "$f" && cp "$f" "$root$f"
done
cp /usr/share/keyrings/debian-archive-* "$root/usr/share/keyrings/" 2>/dev/null
apt-config dump | grep -E '^Acquire::(http|https|Retries)' >"$root/etc/apt/apt.conf.d/90host"
printf '#!/bin/sh\nexit 101\n' >"$root/usr/sbin/policy-rc.d" # packages start no service in here
chmod 755 "$root/usr/sbin/policy-rc.d"

mkdir -p "$root/root"
git clone -q --no-hardlinks . "$root/root/blackburst" || exit 1
lap "a clone of $(git rev-parse --short HEAD)"

# inside COMMAND: in the root, in namespaces of its own that end with it.
inside() {
	# shellcheck disable=SC2016
	setsid unshare --mount --propagation private --pid --fork --kill-child sh -c '
		mount -t proc proc "$1/proc" && mount -t sysfs -o ro sysfs "$1/sys" && mount -t tmpfs tmpfs "$1/dev/shm" &&
			mount -t devpts -o newinstance,ptmxmode=0666 devpts "$1/dev/pts" || exit 125
		exec chroot "$1" /usr/bin/env -i HOME=/root PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin \
			sh -c "cd /root/blackburst && $2"' sh "$root" "$1" </dev/null &
	child=$!
	wait $child; status=$?; child=
	return $status
}

[ $# -gt 0 ] || set -- "make run" "make check"
for command; do
	inside "$command"; status=$?
	lap "$command (exit $status)"
	[ $status = 0 ] || { echo "fresh: '$command' failed on a fresh Debian 12"; exit 1; }
done
echo "fresh: works on a fresh Debian 12"
