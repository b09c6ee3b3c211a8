#!/bin/sh
# tests/check-hw.sh ROOM [--switch PDU/OUTLET]... [--standin]: the contracts of the device classes against the devices of
# a room file (tests/hw_room.c). Leaves a dated record in build/check-hw/, or in the file $RECORD names. Exit 0: all that
# could be checked passed; 1: something failed; 2: not a room.
set -u
cd "$(dirname "$0")/.." || exit 2
[ $# -ge 1 ] || { sed -n '2,4s/^# //p' "$0" >&2; exit 2; }
hw=${BB_HW_ROOM:-build/gcc/tests/hw_room}
[ -x "$hw" ] || { echo "check-hw: $hw is not built: make check-hw ROOM=$1" >&2; exit 2; }
date=$(date -u +%Y-%m-%dT%H:%M:%SZ)
record=${RECORD:-build/check-hw/$(basename "$1" .yaml)-$(echo "$date" | tr -d ':-').json}
mkdir -p "$(dirname "$record")"
"$hw" "$@" --date "$date" --out "$record"
code=$?
[ $code = 2 ] || echo "check-hw: the record is $record"
exit $code
