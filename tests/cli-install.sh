#!/bin/sh
# `make install` into a folder: what was installed runs from there, and the systemd units are well-formed and confined.
. tests/cli.sh.inc
root=$work/root
share=$root/usr/share/blackburst

installed() {
	for file in bin/blackburst share/man/man1/blackburst.1 share/blackburst/shutter.eds \
		share/blackburst/rooms/profiles/desktop-gpu.yaml share/blackburst/scenes/walk.path \
		../etc/udev/rules.d/70-blackburst.rules ../etc/sysusers.d/blackburst.conf; do
		[ -s "$root/usr/$file" ] || { echo "$file was not installed"; return 1; }
	done
	! grep -rq '@PREFIX@' "$root/etc"
}

runs() {
	(cd "$work" && "$root/usr/bin/blackburst" run "$share/rooms/desk.yaml" "$share/scenes/desk.yaml" --duration 1 \
		--no-pictures --quiet --out "$work/result")
}

confined() { # UNIT: systemd knows every line of it, and finds little that it could do besides
	sed "s,/usr/bin/blackburst,$root&," "$root/etc/systemd/system/blackburst-$1@.service" >"$work/blackburst-$1@x.service"
	systemd-analyze verify --man=no "$work/blackburst-$1@x.service" &&
		systemd-analyze security --offline=true --threshold=25 "$work/blackburst-$1@x.service" >"$work/exposure" ||
		{ tail -n 2 "$work/exposure"; return 1; }
}

# -o all: the program is there, and may be of another variant than make's
check "make install" make -s -o all install DESTDIR="$root" PREFIX=/usr PROGRAM="$program"
check "everything is there" installed
check "the installed program runs an installed room" runs
if command -v systemd-analyze >/dev/null; then
	check "the run unit is confined" confined run
	check "the serve unit is confined" confined serve
else
	echo "SKIP: there is no systemd-analyze to judge the units"
fi
check "make uninstall" make -s uninstall DESTDIR="$root" PREFIX=/usr
check "and nothing is left" [ -z "$(find "$root" -type f)" ]
finish
