#!/bin/sh
# Tracking on wires and in files: clients written in Python read what `track serve` and `run --stream` send, and hostile
# ones do not stop it; what `run --record` wrote gives the same poses again, bit for bit, and is read as far as it goes when
# it is cut; NatNet datagrams are imported.
. tests/cli.sh.inc

serve() { # ARGUMENTS...: on free ports; sets pid, natnet, vrpn
	"$program" track serve --stream natnet:0,vrpn:0 --json "$@" >"$work/serve.json" 2>"$work/serve.err" &
	pid=$!
	for i in $(seq 100); do
		grep -q '^}' "$work/serve.json" 2>/dev/null || ! kill -0 $pid 2>/dev/null && break
		sleep 0.05
	done
	natnet=$(field "$work/serve.json" 'r["natnet_command_port"]')
	vrpn=$(field "$work/serve.json" 'r["vrpn_port"]')
}
stop() {
	kill -TERM $pid
	wait $pid
}
client() { # NAME ARGUMENTS...: what it read, in $work/NAME
	name=$1
	shift
	timeout 20 python3 tests/mocap_client.py "$@" >"$work/$name" 2>"$work/$name.err" || cat "$work/$name.err"
}
is() { # FILE EXPRESSION
	[ "$(field "$work/$1" "$2")" = True ]
}
ends() { # CODE COMMAND...
	want=$1
	shift
	"$@" >"$work/out" 2>"$work/err"
	[ $? = "$want" ] || { cat "$work/out" "$work/err"; false; }
}
says() { grep -q -e "$1" "$work/out" "$work/err"; }

# A viewer who stands, read by three clients at once.
serve rooms/cabin.yaml --rate 100
client n natnet "$natnet" 0.6 &
n=$!
client v vrpn "$vrpn" glasses@127.0.0.1 0.6 &
v=$!
client l lob "$vrpn" glasses,nobody 0.6
wait $n $v
stop
check "NatNet: server, models, frames" is n "r['server']['name'] == 'blackburst' and r['server']['natnet'] == [3, 0, 0, 0] and \
r['server']['hz'] == 10**9 and r['server']['bytes'] == 279 and r['echo'] == 4711 and r['rate'] == 100 and \
[(m['kind'], m['name'], len(m['markers'])) for m in r['models']] == \
[(1, 'glasses', 5), (0, 'glasses', 5), (0, 'all', 5)] and abs(r['models'][0]['markers'][1][0] - 0.151) < 1e-7 and len(r['frames']) > 10 and all(b['number'] - a['number'] == 1 and b['mid'] - a['mid'] == 10**7 and \
b['sent'] >= b['mid'] for a, b in zip(r['frames'], r['frames'][1:]))"
check "... where the eyes stand" is n "all(abs(f['bodies']['1']['at'][i] - [-0.075, 1.608, -0.016][i]) < 1e-6 and \
f['bodies']['1']['tracked'] and abs(f['markers'][1]['at'][0] - 0.076) < 1e-6 and len(f['sets']['all']) == 5 \
for f in r['frames'] for i in range(3))"
check "VRPN: cookie, senders, poses, velocities, pong" is v "r['senders'] == r['pongs'] == ['glasses'] and \
r['cookie'] == '7672706e3a207665722e2030372e3338202030' + 5 * '00' and len(r['poses']) > 10 and \
all(abs(p['p'][1] - 1.608) < 1e-12 and p['q'] == [0, 0, 0, 1] for p in r['poses']) and \
len(r['velocities']) > 10 and all(x == 0 for p in r['velocities'] for x in p['v'])"
check "VRPN calls back who sends a lob" is l "len(r['poses']) > 10 and r['pongs'] == ['glasses']"
check "all counted" grep -q 'VRPN: .* 0 dropped, 2 connections, 0 refused' "$work/serve.err"

# One who walks: both protocols tell the same.
serve rooms/cabin.yaml --path scenes/walk.path --rate 120
beyond=$(for inode in $(ls -l /proc/$pid/fd | sed -n 's/.*socket:\[\([0-9]*\)\].*/\1/p'); do
	grep -h " $inode " /proc/net/tcp /proc/net/udp | awk '$2 !~ /^......7F:/'; done)
check "only loopback sockets" [ -z "$beyond" ]
client both both "$natnet,$vrpn" glasses 0.5
python3 - "$natnet" "$vrpn" >"$work/hostile" 2>&1 <<END
import random, socket, struct, sys
r, n, v = random.Random(7), ("127.0.0.1", int(sys.argv[1])), ("127.0.0.1", int(sys.argv[2]))
u = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
for i in range(2000):
    u.sendto(r.randbytes(r.randrange(64)), n)
    u.sendto(struct.pack("<HH", r.randrange(16), 8) + r.randbytes(8), n)
    u.sendto(r.choice([b"127.0.0.1 9", b"10.0.0.1 4000", b"127.0.0.1 99999", r.randbytes(20)]), v)
held = []
for i in range(20):
    t = socket.create_connection(v, 5)
    t.sendall(r.choice([r.randbytes(100), b"vrpn: ver. 07.35  0" + bytes(5) + struct.pack(">6i", 1 << 30, 0, 0, 0, 0, 0), b"v"]))
    held.append(t)
END
check "hostile clients are not in the way" [ ! -s "$work/hostile" ]
client again natnet "$natnet" 0.3
check "... of others" is again "len(r['frames']) > 10"
stop
check "... and the server ends well" [ $? = 0 ]
serve rooms/cabin.yaml --path scenes/walk.path --rate 1000
python3 -c 'import socket, sys, time
s = socket.socket()
s.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
s.connect(("127.0.0.1", int(sys.argv[1])))
s.sendall(b"vrpn: ver. 07.38  0" + bytes(5))
time.sleep(1.5)' "$vrpn"
stop
check "who does not read gets no old poses later" grep -q 'VRPN: .* [1-9][0-9]* dropped' "$work/serve.err"
cat >"$work/same.py" <<END
import json, sys
r = json.load(open(sys.argv[1]))
n, v = r["n"], r["v"]
there = {f["mid"] // 1000: f["bodies"]["1"] for f in n["frames"]}
both = [(there[round(p["at"] * 1e6)], p) for p in v["poses"] if p["sender"] == "glasses" and round(p["at"] * 1e6) in there]
assert len(both) > 5, len(both)
assert all(abs(a - b) < 2e-7 for x, p in both for a, b in zip(x["at"] + x["q"], p["p"] + p["q"])), both[0]
assert max(abs(s["v"][0]) for s in v["velocities"]) > 0.01
END
check "NatNet and VRPN tell the same poses" python3 "$work/same.py" "$work/both"

check "another address wants names" ends 2 "$program" track serve rooms/cabin.yaml --bind 0.0.0.0 --for 1
check "... with its number" says BB1761
check "no such address" ends 2 "$program" track serve rooms/cabin.yaml --bind localhost --for 1
check "a protocol nobody knows" ends 2 "$program" track serve rooms/cabin.yaml --stream opentrack --for 1
check "no room" ends 2 "$program" track serve --for 1

# Multicast, kept on the loopback interface: frames go to the group, and to nobody else.
serve rooms/cabin.yaml --multicast 127.0.0.1
python3 - "$natnet" >"$work/group" 2>&1 <<END
import socket, struct, sys
g = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
g.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
g.bind(("239.255.42.99", 1511))
g.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton("239.255.42.99") + socket.inet_aton("127.0.0.1"))
g.settimeout(10)
u = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
u.settimeout(10)
u.sendto(bytes(4), ("127.0.0.1", int(sys.argv[1])))
info = u.recv(65535)
assert info[:2] == b"\1\0" and struct.unpack_from("<HB4B", info, 4 + 272) == (1511, 1, 239, 255, 42, 99), info
assert all(g.recv(65535)[:2] == b"\7\0" for i in range(20))
u.settimeout(0.1)
try:
    print("a frame to one:", u.recv(65535)[:4])
except socket.timeout:
    pass
END
check "multicast, on loopback" sh -c "[ ! -s '$work/group' ] || { cat '$work/group'; false; }"
stop

# Another address, in a network of its own where there is nobody else: only who is named is heard.
cat >"$work/alone.sh" <<END
ip link set lo up
for n in 1 2 3; do ip address add 10.9.9.\$n/32 dev lo; done
$program track serve rooms/cabin.yaml --bind 10.9.9.1 --allow 10.9.9.2 --for 2 >"$work/alone.out" 2>"$work/alone.err" &
python3 - <<PY
import socket, time
def asks(me):
    u = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    u.bind((me, 0))
    u.settimeout(0.5)
    for i in range(10):
        u.sendto(bytes(4), ("10.9.9.1", 1510))
        try:
            return u.recv(65535)[:2] == b"\\1\\0"
        except OSError:
            pass
    return False
def calls(me):
    try:
        t = socket.create_connection(("10.9.9.1", 3883), 2, (me, 0))
        t.settimeout(0.5)
        return t.recv(24)[:4] == b"vrpn"
    except OSError:
        return False
time.sleep(0.2)
print(asks("10.9.9.2"), calls("10.9.9.2"), calls("10.9.9.3"), flush=True)
u = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
u.bind(("10.9.9.3", 0))
u.settimeout(0.3)
u.sendto(bytes(4), ("10.9.9.1", 1510))
try:
    print("heard", u.recv(100))
except OSError:
    print("unheard")
PY
wait
END
if unshare -rn true 2>/dev/null && command -v ip >/dev/null; then
	unshare -rn sh "$work/alone.sh" >"$work/alone" 2>&1
	check "who is named is heard, others are not" [ "$(cat "$work/alone")" = "True True False
unheard" ]
	check "... and counted" grep -q 'NatNet: .* 1 heard, 1 refused.* 1 refused$' "$work/alone.err"
else
	echo "SKIP: no network namespaces here: --allow was not tried"
fi

# A run that streams and records; then the recording is served, and tracked again.
cat >"$work/tracked.yaml" <<END
scene: tracked
technique: calibration
head_path: scenes/walk.path
wand_path: scenes/seated.path
duration_s: 3
needs: {cameras: 1, gamepads: 1}
END
run="$program run rooms/cabin.yaml $work/tracked.yaml --quiet --out $work/result"
$run --clock posix --gl cpu --no-pictures --duration 60 --stream natnet:0,vrpn:0 --record "$work/posix.bbtrack.zst" 2>"$work/run.err" &
pid=$!
for i in $(seq 100); do
	grep -q '^VRPN: wand' "$work/run.err" 2>/dev/null && break
	sleep 0.05
done
client n natnet "$(sed -n 's/^NatNet.*command port \([0-9]*\).*/\1/p' "$work/run.err")" 0.8
stop
check "a run's head, tracked" is n "len(r['frames']) > 5 and [m['name'] for m in r['models']] == \
['glasses', 'glasses', 'wand', 'wand', 'all'] and \
sum(f['bodies']['1']['tracked'] and 1.2 < f['bodies']['1']['at'][1] < 2.2 for f in r['frames']) > 5"
check "... and counted" [ "$(field "$work/result/result.json" 'r["counters"]["natnet_datagrams_sent"] > 5')" = True ]
check "a run in real time, tracked again" ends 0 "$program" track replay "$work/posix.bbtrack.zst" --room rooms/cabin.yaml --json
check "... the same bit for bit" is out "r['same'] and r['poses_same'] == r['poses_recorded'] == r['poses_replayed'] > 20"

$run --record "$work/a.bbtrack" && $run --record "$work/b.bbtrack.zst"
check "virtual time: tracked again" ends 0 "$program" track replay "$work/a.bbtrack" --room rooms/cabin.yaml --csv "$work/a.csv" --json
check "... the same, of both bodies" is out "r['same'] and r['poses_same'] > 400 and r['camera_frames'] > 1500 and r['gamepad_reports'] > 10"
check "... as a table" sh -c "head -1 '$work/a.csv' | grep -q 'at_ns,x_m.*position_sigma_mm' && grep -q wand '$work/a.csv'"
check "compressed and not, the same" sh -c "'$program' track replay '$work/b.bbtrack.zst' --csv '$work/b.csv' >/dev/null && cmp '$work/a.csv' '$work/b.csv'"
check "speed" sh -c "'$program' track replay '$work/a.bbtrack' --speed 10 >/dev/null"
$run --duration 6 --fault "at 1.0s camera/c3 bump deg=1" --record "$work/k.bbtrack"
check "a camera is knocked and set aside" sh -c "grep -c '^f 2 [0-9]* [0-9-]* [0-9]* [0-9]* 0 0 ' '$work/k.bbtrack' | grep -q '...'"
check "... tracked again, the same" ends 0 "$program" track replay "$work/k.bbtrack" --room rooms/cabin.yaml
awk '$1 == "f" && $9 > 0 && ++n == 900 { $10 += 2 } 1' "$work/a.bbtrack" >"$work/moved.bbtrack"
check "a blob elsewhere is another pose" ends 1 "$program" track replay "$work/moved.bbtrack" --room rooms/cabin.yaml
check "... with its number" says BB1765
sed '$a # changed' rooms/cabin.yaml >"$work/cabin.yaml"
check "another room file" ends 2 "$program" track replay "$work/a.bbtrack" --room "$work/cabin.yaml"
check "... with its number" says BB1764
check "... if it must be" ends 0 "$program" track replay "$work/a.bbtrack" --room "$work/cabin.yaml" --any-room
for name in a.bbtrack b.bbtrack.zst; do
	head -c "$(($(wc -c <"$work/$name") * 3 / 4))" "$work/$name" >"$work/cut.${name#*.}"
	check "$name cut: what there is" ends 1 "$program" track replay "$work/cut.${name#*.}" --room rooms/cabin.yaml --json
	check "... with its number" says BB1763
	check "... is used" is out "r['truncated'] and r['same'] and r['poses_same'] > 200"
done
head -c 3000 rooms/cabin.yaml >"$work/no.bbtrack"
check "no recording" ends 2 "$program" track replay "$work/no.bbtrack"
check "... with its number" says BB1762
check "nobody listens to virtual time" ends 2 $run --stream vrpn
check "... with its number" says BB1766
$run --duration 600 --record "$work/stopped.bbtrack" --clock posix --gl cpu --no-pictures &
pid=$!
for i in $(seq 200); do
	[ "$(cat "$work/stopped.bbtrack.$pid.part" 2>/dev/null | wc -c)" -gt 40000 ] && break
	sleep 0.05
done
kill -9 $pid
wait $pid 2>/dev/null
check "a run that is killed leaves no recording under its name" [ ! -e "$work/stopped.bbtrack" ]
check "... but what it had" ends 1 "$program" track replay "$work/stopped.bbtrack.$pid.part" --room rooms/cabin.yaml
check "... to be read" sh -c "grep -q BB1763 '$work/err' && grep -q 'tracked again: [1-9]' '$work/out'"

serve --replay "$work/b.bbtrack.zst" --repeat
client both both "$natnet,$vrpn" glasses,wand 0.5
stop
check "a recording served" is both "len(r['n']['frames']) > 10 and all(f['params'] & 1 for f in r['n']['frames']) and \
{p['sender'] for p in r['v']['poses']} == {'glasses', 'wand'} and r['v']['pongs'] == ['glasses', 'wand']"
check "... the same on both ways" python3 "$work/same.py" "$work/both"

# Import: what we streamed, recorded by somebody as datagrams.
serve --replay "$work/a.bbtrack" --repeat
python3 - "$natnet" "$work/d.bin" <<END
import socket, struct, sys, time
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
s.settimeout(10)
s.sendto(bytes(4), ("127.0.0.1", int(sys.argv[1])))
s.sendto(b"\4\0\0\0", ("127.0.0.1", int(sys.argv[1])))
with open(sys.argv[2], "wb") as f:
    end = time.monotonic() + 1
    while time.monotonic() < end:
        f.write(s.recv(65535))
END
stop
check "an import" ends 0 "$program" track import "$work/d.bin" --out "$work/d.bbtrack.zst" --json
check "... of both bodies" is out "r['bodies'] == ['glasses', 'wand'] and r['poses'] > 10 and not r['left_out']"
check "... can be read" ends 0 "$program" track replay "$work/d.bbtrack.zst" --csv "$work/d.csv"
check "... as a table" ends 0 "$program" track import "$work/d.bin" --out "$work/e.csv"
check "... the same one" cmp "$work/d.csv" "$work/e.csv"
cat >"$work/table.py" <<END
import csv, sys
a, d = ({(r["body"], round(int(r["at_ns"]) / 1e4)): r for r in csv.DictReader(open(p))} for p in sys.argv[1:])
both = [(a[k], d[k]) for k in d if k in a]
assert len(both) > 10, (len(a), len(d), len(both))
assert all(abs(float(x[c]) - float(y[c])) < 2e-7 for x, y in both for c in ("x_m", "y_m", "z_m", "qx_1", "qw_1"))
END
check "... and the poses that were recorded" python3 "$work/table.py" "$work/a.csv" "$work/d.csv"
head -c 5000 "$work/d.bin" >"$work/cut.bin"
check "half a datagram" ends 1 "$program" track import "$work/cut.bin" --out "$work/f.csv"
check "... with its number" says BB1767
check "... leaves what was whole" sh -c "[ \$(wc -l <'$work/f.csv') -gt 3 ]"
check "no datagrams" ends 2 "$program" track import rooms/cabin.yaml --out "$work/g.csv"
check "... and no file" [ ! -e "$work/g.csv" ]
finish
