#!/bin/sh
# Unpacks one file, example4d.nii.gz, from Debian's python3-nibabel package into build/data/ without installing the
# package. Always exits 0: where the file cannot be had, it says why, and cme.yaml is what can be run. No network when
# the file is there already. Run it from the top of the tree.
set -u
dest=build/data/example4d.nii.gz
sum=42097dfbab9d2a036b41ae5c97a359591cf2cf5c3f8dc6ca6455c0b8a7f22696
package=python3-nibabel
inside=./usr/lib/python3/dist-packages/nibabel/tests/data/example4d.nii.gz
apt_quick='-q -o Acquire::Retries=1 -o Acquire::http::Timeout=15 -o Acquire::https::Timeout=15'

is_right() {
	[ -f "$1" ] && echo "$sum  $1" | sha256sum -c --status 2>/dev/null
}

give_up() {
	echo "data: no example4d.nii.gz ($1); scenes/epi.yaml cannot run, use scenes/cme.yaml"
	exit 0
}

is_right "$dest" && exit 0
for tool in apt-get dpkg-deb tar sha256sum; do
	command -v "$tool" >/dev/null 2>&1 || give_up "$tool is not installed"
done
tmp=$(mktemp -d) || give_up "no temporary directory"
trap 'rm -rf "$tmp"' EXIT
trap 'exit 1' HUP INT TERM
chmod 755 "$tmp"
# apt fetches as the user _apt when root asks; it must be able to write here.
[ "$(id -u)" = 0 ] && chown _apt "$tmp" 2>/dev/null

download() {
	# shellcheck disable=SC2086
	(cd "$tmp" && apt-get $apt_quick download "$package") >"$tmp/log" 2>&1
}

as_root() {
	if [ "$(id -u)" = 0 ]; then "$@"; else sudo -n "$@"; fi
}

echo "data: fetching $package from the Debian mirror for one file, $dest (it is not installed)"
if ! download; then
	# Only a machine without package lists needs them fetched.
	if apt-cache show "$package" >/dev/null 2>&1; then
		give_up "$(tail -n 1 "$tmp/log")"
	fi
	echo "data: no package lists, running apt-get update"
	# shellcheck disable=SC2086
	as_root apt-get $apt_quick update >"$tmp/log" 2>&1 || give_up "$(tail -n 1 "$tmp/log")"
	download || give_up "$(tail -n 1 "$tmp/log")"
fi
deb=$(find "$tmp" -name "${package}_*.deb" | head -n 1)
[ -n "$deb" ] || give_up "apt-get left no package"
dpkg-deb --fsys-tarfile "$deb" 2>/dev/null | tar -xO "$inside" >"$tmp/file" 2>/dev/null
is_right "$tmp/file" || give_up "$(basename "$deb") does not hold the expected file"
mkdir -p build/data
cp "$tmp/file" "$dest.part" 2>/dev/null || give_up "cannot write $dest"
mv "$dest.part" "$dest"
echo "data: $dest is there"
