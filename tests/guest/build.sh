#!/bin/sh
# tests/guest/build.sh PROGRAM...: everything a guest needs, in build/guest/: vmlinux (Debian's own kernel, unpacked and
# never installed), base.cpio (init, tools, libraries, kernel modules) and programs.cpio (the named programs that a case
# of cases.txt mentions, and the modules of sim/kmod/), environment (what base.cpio, kernel and QEMU hash to) and key (the
# same with programs.cpio). What was fetched is kept. Exit 77 after "SKIP: why" where the packages cannot be had.
set -eu
cd "$(dirname "$0")/../.."
here=tests/guest
out=build/guest
apt_quick='-q -o Acquire::Retries=1 -o Acquire::http::Timeout=20 -o Acquire::https::Timeout=20 -o DPkg::Lock::Timeout=500'
# Folders of the kernel's modules that hold what cases may ask for, and what those depend on; all of them are 400 MB.
folders='drivers/firmware drivers/gpio drivers/hid drivers/i2c drivers/input drivers/media drivers/mfd drivers/misc
	drivers/net/can drivers/pps drivers/usb drivers/virtio fs/configfs fs/fuse lib net/can'

skip() {
	echo "SKIP: $1"
	exit 77
}

log=$(mktemp)
stage=$(mktemp -d)
trap 'rm -rf "$log" "$stage"' EXIT
trap 'exit 1' HUP INT TERM
chmod 755 "$stage"
mkdir -p "$out"

as_root() {
	if [ "$(id -u)" = 0 ]; then "$@"; else sudo -n "$@"; fi
}

# ---- packages: fetched as files, unpacked below build/guest/, never installed ----

kernel_name() {
	apt-cache depends linux-image-amd64 2>/dev/null | sed -n 's/^ *Depends: *linux-image-//p' | head -n 1
}

package_version() {
	apt-cache show --no-all-versions "$1" 2>/dev/null | sed -n 's/^Version: //p' | head -n 1
}

fetch() { # FOLDER PACKAGE=VERSION...
	folder=$1
	shift
	mkdir -p "$folder"
	# apt fetches as the user _apt when root asks; it must be able to write here.
	[ "$(id -u)" = 0 ] && chown _apt "$folder" 2>/dev/null
	# shellcheck disable=SC2086
	(cd "$folder" && apt-get $apt_quick download "$@") >"$log" 2>&1
}

fetch_kernel() {
	echo "guest: fetching linux-image-$kernel from the Debian mirror (70 MB; it is not installed)"
	fetch "$stage/debs" "linux-image-$kernel=$version" || return 1
	rm -rf "$tree.part"
	mkdir -p "$tree.part"
	members="./boot/vmlinuz-$kernel ./lib/modules/$kernel/modules.builtin ./lib/modules/$kernel/modules.builtin.modinfo"
	members="$members ./lib/modules/$kernel/modules.order"
	for folder in $folders; do
		members="$members ./lib/modules/$kernel/kernel/$folder"
	done
	# A folder this kernel does not have makes tar complain, and nothing else: what is missing shows below.
	# shellcheck disable=SC2086
	dpkg-deb --fsys-tarfile "$stage"/debs/linux-image-*.deb | tar -x -C "$tree.part" $members 2>/dev/null || true
	extract_vmlinux "$tree.part/boot/vmlinuz-$kernel" "$tree.part/vmlinux"
	rm -r "$tree.part/boot"
	mv "$tree.part" "$tree"
}

# The uncompressed kernel starts by QEMU's PVH entry; unpacking itself in the guest would take it 5 to 12 s.
extract_vmlinux() {
	at=$(LC_ALL=C grep -abo "$(printf '\3757zXZ')" "$1" | head -n 1 | cut -d: -f1)
	[ -n "$at" ] || { echo "guest: no xz stream in $1" >&2; return 1; }
	tail -c +$((at + 1)) "$1" | xz -dc --single-stream >"$2" 2>/dev/null || [ -s "$2" ]
}

# Sets kernel, version and tree; a kernel that is not there yet is fetched.
find_kernel() {
	kernel=$(kernel_name)
	[ -n "$kernel" ] || return 1
	version=$(package_version "linux-image-$kernel")
	tree=$out/kernel-${kernel}_$version
	[ -d "$tree" ] || fetch_kernel
}

get_kernel() {
	find_kernel && return
	# No package lists, or lists so old that the mirror has moved on.
	# shellcheck disable=SC2086
	as_root apt-get $apt_quick update >"$log" 2>&1 && find_kernel && return
	# No mirror: a kernel that was fetched earlier will do.
	tree=$(find "$out" -maxdepth 1 -name 'kernel-*_*' ! -name '*.part' | LC_ALL=C sort | tail -n 1)
	[ -n "$tree" ] || skip "the package linux-image-amd64 cannot be had: $(tail -n 1 "$log")"
	kernel=${tree#"$out"/kernel-} kernel=${kernel%%_*}
	version=${tree##*_}
}

# ---- our own kernel modules, built against the headers of exactly this kernel ----

get_headers() {
	headers=$out/headers-${kernel}_$version
	[ -d "$headers" ] && return
	abi=${kernel%-amd64}
	echo "guest: fetching the headers of $kernel (14 MB; they are not installed)"
	fetch "$stage/headers" "linux-headers-$kernel=$version" "linux-headers-$abi-common=$version" \
		"linux-kbuild-${abi%%.0-*}=$version" || return 1
	rm -rf "$headers.part"
	for deb in "$stage"/headers/*.deb; do
		dpkg-deb -x "$deb" "$headers.part"
	done
	# The one absolute path in there.
	sed -i "s|^include /usr/src/|include $PWD/$headers/usr/src/|" "$headers.part/usr/src/linux-headers-$kernel/Makefile"
	mv "$headers.part" "$headers"
}

build_modules() { # FOLDER: leaves build/guest/NAME-OF-FOLDER/*.ko
	built=$out/$(echo "$1" | tr / -)
	rm -rf "$built"
	[ -n "$(find "$1" -name '*.c' 2>/dev/null)" ] || return 0
	get_headers || skip "the headers of $kernel cannot be had: $(tail -n 1 "$log")"
	cp -r "$1" "$built"
	[ -f "$built/Kbuild" ] || [ -f "$built/Makefile" ] ||
		(cd "$built" && for c in *.c; do echo "obj-m += ${c%.c}.o"; done >Kbuild)
	make -s -C "$headers/usr/src/linux-headers-$kernel" M="$PWD/$built" \
		KCFLAGS="-fmacro-prefix-map=$PWD/$built/=" modules >"$log" 2>&1 ||
		{ cat "$log" >&2; echo "guest: $1 does not build for $kernel" >&2; exit 1; }
	# Debug data hold this machine's paths, and the build id hashes them: neither may reach the guest's key.
	for module in "$built"/*.ko; do
		objcopy --strip-debug -R .note.gnu.build-id "$module"
	done
}

# ---- the initramfs ----

# Programs and scripts that a case mentions; and always all scripts.
copy_programs() {
	mkdir -p "$stage/programs/bb" "$stage/programs/usr/lib/modules/$kernel/extra"
	for program in "$@"; do
		grep -v '^#' $here/cases.txt $here/case_*.sh | grep -qw "$(basename "$program")" || continue
		cp "$program" "$stage/programs/bb/"
		objcopy --strip-all -R .note.gnu.build-id "$stage/programs/bb/$(basename "$program")"
	done
	for script in $here/case_*.sh; do
		[ ! -f "$script" ] || cp "$script" "$stage/programs/bb/"
	done
	for module in "$out"/sim-kmod/*.ko; do
		[ ! -f "$module" ] || cp "$module" "$stage/programs/usr/lib/modules/$kernel/extra/"
	done
}

copy_tools() {
	mkdir -p "$root/usr/bin" "$root/usr/sbin" "$root/usr/lib64" "$root/usr/lib/systemd" "$root/usr/lib/udev/rules.d" "$root/etc"
	for link in bin sbin lib lib64; do
		ln -s "usr/$link" "$root/$link"
	done
	for tool in /usr/bin/busybox $(sed 's/#.*//' $here/tools.txt); do
		[ -x "$tool" ] || skip "$tool is not installed (packages-kernel.txt)"
		cp -L "$tool" "$root$tool"
		echo "$tool" >>"$stage/binaries"
	done
	gcc -std=gnu11 -Os -o "$root/usr/bin/align" $here/align.c
	objcopy --strip-all -R .note.gnu.build-id "$root/usr/bin/align"
	ln -s dash "$root/usr/bin/sh"
	ln -s ../bin/kmod "$root/usr/sbin/modprobe"
	# Enough rules that a device is named, known to be an input device or not, and gets its driver.
	for rules in 50-udev-default 60-input-id 60-evdev 80-drivers; do
		cp "/usr/lib/udev/rules.d/$rules.rules" "$root/usr/lib/udev/rules.d/"
	done
	cp drivers/70-blackburst.rules "$root/usr/lib/udev/rules.d/"
	echo 'root:x:0:0:root:/tmp:/usr/bin/busybox' >"$root/etc/passwd"
	{ echo root; sed -n 's/.*GROUP="\([a-z]*\)".*/\1/p' "$root"/usr/lib/udev/rules.d/*.rules; } | LC_ALL=C sort -u |
		awk '{ print $1 ":x:" ($1 == "root" ? 0 : 100 + NR) ":" }' >"$root/etc/group"
	cp "$out/tests-guest-kmod/bb_stop.ko" "$root/usr/lib/"
	install -m 755 $here/init "$root/init"
}

copy_libraries() {
	find "$stage/programs/bb" -type f ! -name '*.sh' >>"$stage/binaries"
	xargs ldd <"$stage/binaries" 2>/dev/null | awk '$2 == "=>" && $3 ~ /^\// { print $3 } $1 ~ /^\// && NF == 2 { print $1 }' |
		grep -v ':$' | LC_ALL=C sort -u >"$stage/libraries"
	while read -r library; do
		case $library in /usr/*) to=$library ;; *) to=/usr$library ;; esac
		mkdir -p "$root${to%/*}"
		cp -L "$library" "$root$to"
	done <"$stage/libraries"
}

# Modules the cases name, and what those depend on. A name nobody has is kept for run.sh to complain about.
copy_modules() {
	modules=$root/usr/lib/modules/$kernel
	mkdir -p "$modules" "$tree/lib/modules/$kernel/extra"
	rm -f "$tree/lib/modules/$kernel"/extra/*
	cp "$stage/programs/usr/lib/modules/$kernel/extra/"*.ko "$tree/lib/modules/$kernel/extra/" 2>/dev/null || true
	depmod -b "$tree" "$kernel"
	: >"$out/missing-modules"
	sed 's/#.*//' $here/cases.txt | awk 'NF > 3 { n = split($3, m, ","); for (i = 1; i <= n; i++) print m[i] }' |
		sed 's/:.*//' | LC_ALL=C sort -u >"$stage/names"
	echo qemu_fw_cfg >>"$stage/names"
	while read -r name; do
		[ "$name" != - ] && [ "$name" != udevd ] || continue
		modprobe -d "$tree" -S "$kernel" --show-depends "$name" >"$log" 2>&1 ||
			{ echo "$name" >>"$out/missing-modules"; continue; }
		sed -n 's/^insmod \([^ ]*\).*/\1/p' "$log" >>"$stage/modules"
	done <"$stage/names"
	LC_ALL=C sort -u "$stage/modules" | while read -r file; do
		inside=${file##*/lib/modules/"$kernel"/}
		mkdir -p "$modules/${inside%/*}"
		cp "$file" "$modules/$inside"
	done
	cp "$tree/lib/modules/$kernel"/modules.builtin* "$tree/lib/modules/$kernel/modules.order" "$modules/"
	depmod -b "$root" "$kernel"
	# They travel with the programs: what changes with our sources must not change the environment.
	rm -rf "$modules/extra"
}

# The same bytes from the same files, whoever packs them and when.
pack() { # FOLDER FILE
	find "$1" -exec touch -h -d @0 {} +
	(cd "$1" && find . | LC_ALL=C sort | cpio --quiet -o -H newc --reproducible -R 0:0) >"$2.part"
	mv "$2.part" "$2"
}

get_kernel
build_modules sim/kmod
build_modules tests/guest/kmod
root=$stage/root
mkdir -p "$root"
copy_programs "$@"
copy_tools
copy_libraries
copy_modules
pack "$root" "$out/base.cpio"
pack "$stage/programs" "$out/programs.cpio"
cat "$out/base.cpio" "$out/programs.cpio" >"$out/guest.cpio"
ln -sf "${tree##*/}/vmlinux" "$out/vmlinux"
{
	echo "${MEMORY:-256}"
	cat "$out/vmlinux" "$(command -v qemu-system-x86_64)" "$out/base.cpio" $here/machine.sh
} | sha256sum | cut -c1-16 >"$out/environment"
cat "$out/environment" "$out/programs.cpio" | sha256sum | cut -c1-16 >"$out/key"
echo "guest: kernel $kernel ($version), initramfs $(($(wc -c <"$out/guest.cpio") / 1048576)) MiB, key $(cat "$out/environment")/$(cat "$out/key")"
