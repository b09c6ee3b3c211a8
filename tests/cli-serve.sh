#!/bin/sh
# `blackburst serve`: only loopback sockets exist, a stock Modbus client reads it, its USB devices are listed and answer,
# hostile clients do not stop it, faults are planted, another address is refused without a token that is one.
. tests/cli.sh.inc

start() { # ARGUMENTS...: serves on free ports, sets pid and port
	"$program" serve "${room:-rooms/cabin.yaml}" --modbus-port 0 --usbip-port 0 --json "$@" >"$work/serve.json" 2>"$work/err" &
	pid=$!
	tries=0
	until grep -q '^}' "$work/serve.json" 2>/dev/null || [ $tries = 100 ] || ! kill -0 $pid 2>/dev/null; do
		sleep 0.05
		tries=$((tries + 1))
	done
	port=$(field "$work/serve.json" '[e["where"] for e in r["endpoints"] if e["wire"] == "modbus-tcp"][0].split(":")[-1]')
	usb_port=$(field "$work/serve.json" '[e["where"] for e in r["endpoints"] if e["wire"] == "usbip"][0].split()[0].split(":")[-1]')
}

stop() {
	kill -TERM $pid
	wait $pid
}

# Every socket of the process, by its inode in the kernel's tables; prints those that are not on 127.0.0.0/8 or ::1.
beyond_loopback() {
	inodes=$(ls -l /proc/$pid/fd 2>/dev/null | sed -n 's/.*socket:\[\([0-9]*\)\].*/\1/p')
	for inode in $inodes; do
		grep -h " $inode " /proc/net/tcp /proc/net/udp /proc/net/raw 2>/dev/null | awk '$2 !~ /^......7F:/ { print "open: " $2 }'
		grep -h " $inode " /proc/net/tcp6 /proc/net/udp6 /proc/net/raw6 2>/dev/null |
			awk '$2 !~ /^00000000000000000000000001000000:/ { print "open: " $2 }'
	done
}

client() { # PYTHON STATEMENTS: with connect() and talk(bytes) to the first strip
	python3 - "$port" <<END
import socket, struct, sys, time
def connect(where=("127.0.0.1", int(sys.argv[1]))):
    s = socket.create_connection(where, 5)
    s.settimeout(5)
    return s
def pdu(s, data, unit=1, tid=7):
    s.sendall(struct.pack(">HHHB", tid, 0, len(data) + 1, unit) + data)
    return s.recv(300)
good = lambda s: pdu(s, bytes.fromhex("0100000006"))[7:9] == b"\x01\x01"
$1
END
}

# USB/IP spoken from here: devlist() the bus ids and vendor:product of what is free, attach(), descriptor().
usb_client() { # PYTHON STATEMENTS
	python3 - "$usb_port" <<END
import socket, struct, sys, time
def connect(port=int(sys.argv[1])):
    s = socket.create_connection(("127.0.0.1", port), 5)
    s.settimeout(5)
    return s
def whole(s, n):
    data = b""
    while len(data) < n:
        more = s.recv(n - len(data))
        if not more:
            raise OSError("hung up after %d of %d bytes" % (len(data), n))
        data += more
    return data
def devlist(s):
    s.sendall(struct.pack(">HHI", 0x0111, 0x8005, 0))
    version, reply, status, n = struct.unpack(">HHII", whole(s, 12))
    assert (version, reply, status) == (0x0111, 5, 0)
    found = {}
    for i in range(n):
        r = whole(s, 312)
        found[r[256:288].rstrip(b"\\0").decode()] = "%04x:%04x" % struct.unpack(">HH", r[300:304])
        whole(s, 4 * r[311])
    return found
def attach(s, busid):
    s.sendall(struct.pack(">HHI32s", 0x0111, 0x8003, 0, busid.encode()))
    version, reply, status = struct.unpack(">HHI", whole(s, 8))
    if status:
        return None
    r = whole(s, 312)
    return struct.unpack(">II", r[288:296])
def descriptor(s, dev, kind, n): # GET_DESCRIPTOR by CMD_SUBMIT
    setup = struct.pack("<BBHHH", 0x80, 6, kind, 0, n)
    s.sendall(struct.pack(">IIIIIIiiii", 1, 7, dev[0] << 16 | dev[1], 1, 0, 0, n, 0, 0, 0) + setup)
    reply = struct.unpack(">IIIIIiiiii", whole(s, 40)); whole(s, 8)
    assert reply[0] == 3 and reply[1] == 7 and reply[5] == 0, reply
    return whole(s, reply[6])
good = lambda: len(devlist(connect())) > 0
$1
END
}

start --pty
check "it listens" [ -n "$port" ]
n=$(ls -l /proc/$pid/fd | grep -c 'socket:')
check "its sockets are seen ($n)" [ "$n" -ge 2 ]
check "only loopback sockets exist" [ -z "$(beyond_loopback)" ]
check "two strips, each on TCP and on a pty" [ "$(field "$work/serve.json" 'len([e for e in r["endpoints"] if e["wire"][:6] == "modbus"])')" = 4 ]
check "eight cameras, two pads and six monitors on one USB/IP port" [ "$(field "$work/serve.json" 'len([e for e in r["endpoints"] if e["wire"] == "usbip"])')" = 16 ]
check "the pty is there" [ -c "$(field "$work/serve.json" '[e["where"] for e in r["endpoints"] if e["wire"] == "modbus-rtu"][0]')" ]

check "a coil is read" client 'assert pdu(connect(), bytes.fromhex("0100000006")) == bytes.fromhex("00070000000401" "01013F")'
check "an address that is not there" client 'assert pdu(connect(), bytes.fromhex("0100060001"))[7:] == b"\x81\x02"'
check "a unit that is not there" client 'assert pdu(connect(), bytes.fromhex("0100000006"), unit=9)[7:] == b"\x81\x0b"'
check "garbage: hung up, others served" client '
s, t = connect(), connect()
s.sendall(b"GET / HTTP/1.1\r\nHost: x\r\n\r\n")
assert s.recv(300) == b"" and good(t)'
check "half a header, nothing for ever: others served, then hung up" client '
half, silent, t = connect(), connect(), connect()
half.sendall(b"\x00\x07\x00")
begin = time.time()
assert good(t)
assert half.recv(300) == b"" and time.time() - begin < 10
assert good(t)'
check "65 clients: the last is turned away, the first is served" client '
all = [connect() for i in range(64)]
assert good(all[0])
extra = connect()
try:
    assert extra.recv(10) == b""
except ConnectionResetError:
    pass
assert good(all[63])'
sleep 0.2
check "a client that never reads: others served" client '
s, t = connect(), connect()
s.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
s.setblocking(False)
begin = time.time()
try:
    while time.time() - begin < 1:
        s.send(struct.pack(">HHHB", 7, 0, 6, 1) + bytes.fromhex("0100000006"))
except OSError: # full, or hung up: either will do
    pass
assert good(t)'
check "ten thousand random messages: alive, and no state changed" client '
import random
random.seed(7)
for i in range(200):
    s = connect()
    try:
        for k in range(50):
            s.sendall(bytes(random.randrange(256) for x in range(random.randrange(1, 40))))
    except OSError:
        pass
    s.close()
assert pdu(connect(), bytes.fromhex("0100000006"))[9:] == b"\x3f"'

check "USB/IP lists them all" usb_client '
d = devlist(connect())
assert len(d) == 16 and d["1-1"] == d["1-8"] == "131d:0157" and d["1-9"] == "046d:c219" and d["1-10"] == "256f:c62e" and d["1-16"] == "1c40:0534", d'
check "a camera is attached, answers, can be had once only, and is free again" usb_client '
s = connect()
dev = attach(s, "1-3")
d = descriptor(s, dev, 0x0100, 18)
assert len(d) == 18 and d[8:12] == bytes.fromhex("1d135701"), d
assert "c3".encode("utf-16-le") in descriptor(s, dev, 0x0303, 255)
assert "1-3" not in devlist(connect()) and attach(connect(), "1-3") is None and attach(connect(), "1-99") is None
s.close()
time.sleep(0.1)
assert "1-3" in devlist(connect())'
check "USB/IP garbage: hung up, others served" usb_client '
s = connect()
s.sendall(b"GET / HTTP/1.1\r\nHost: x\r\n\r\n")
assert s.recv(300) == b"" and good()'
check "half a USB/IP header, nothing for ever: others served, then hung up" usb_client '
half, silent = connect(), connect()
half.sendall(b"\x01\x11\x80")
begin = time.time()
assert good()
assert half.recv(300) == b"" and silent.recv(300) == b"" and time.time() - begin < 10 and good()'
check "garbage after an attach: hung up, the device is free again" usb_client '
s = connect()
assert attach(s, "1-9")
s.sendall(b"\xff" * 48)
assert s.recv(300) == b""
time.sleep(0.1)
assert "1-9" in devlist(connect())'
check "an attached client that never reads, another that says nothing: others served" usb_client '
s, t = connect(), connect()
dev = attach(s, "1-1")
assert attach(t, "1-2")
s.setblocking(False)
begin = time.time()
try:
    while time.time() - begin < 1:
        s.send(struct.pack(">IIIIIIiiii", 1, 7, dev[0] << 16 | dev[1], 1, 0, 0, 18, 0, 0, 0) + struct.pack("<BBHHH", 0x80, 6, 0x100, 0, 18))
except OSError:
    pass
assert good()'
check "65 USB/IP clients: the last is turned away, the first is served" usb_client '
all = [connect() for i in range(64)]
time.sleep(0.1)
extra = connect()
try:
    assert extra.recv(10) == b""
except ConnectionResetError:
    pass
assert len(devlist(all[0])) == 16'
sleep 1.2
check "a thousand random messages: alive, and everything still there" usb_client '
import random
random.seed(7)
for i in range(100):
    s = connect()
    try:
        if i % 2:
            attach(s, "1-%d" % random.randrange(1, 11))
        for k in range(10):
            s.sendall(bytes(random.choice((0, 0, 1, 2, 3, random.randrange(256))) for x in range(random.randrange(1, 200))))
    except OSError:
        pass
    s.close()
time.sleep(0.2)
assert len(devlist(connect())) == 16'

if command -v mbpoll >/dev/null 2>&1; then
	mbpoll -m tcp -a 1 -p "$port" -t 3:hex -r 1 -c 4 -1 127.0.0.1 >"$work/m" 2>&1
	check "mbpoll reads the identity" sh -c "tr -d ' \t' <'$work/m' | grep -q '^\[1\]:0x4242' && tr -d ' \t' <'$work/m' | grep -q '^\[4\]:0x0006'"
	mbpoll -m tcp -a 1 -p "$port" -t 0 -r 2 -1 127.0.0.1 0 >"$work/m" 2>&1
	check "mbpoll switches outlet 2 off" grep -q 'Written 1' "$work/m"
	sleep 0.1
	mbpoll -m tcp -a 1 -p "$port" -t 1 -r 1 -c 6 -1 127.0.0.1 >"$work/m" 2>&1
	check "mbpoll reads the contacts" [ "$(sed -n 's/^\[[0-9]\]:[ \t]*//p' "$work/m" | tr -d '\n')" = 101111 ]
	tty=$(field "$work/serve.json" '[e["where"] for e in r["endpoints"] if e["wire"] == "modbus-rtu"][0]')
	mbpoll -m rtu -a 1 -b 19200 -P even -t 0 -r 1 -c 6 -1 "$tty" >"$work/m" 2>&1
	check "mbpoll reads the same strip over RTU" [ "$(sed -n 's/^\[[0-9]\]:[ \t]*//p' "$work/m" | tr -d '\n')" = 101111 ]
else
	echo "SKIP: mbpoll is not installed: no stock client judges serve"
fi
check "still only loopback sockets" [ -z "$(beyond_loopback)" ]
stop
check "SIGTERM ends it with 0" [ $? = 0 ]

start --fault "at 2s camera/c3 unplug for 1s" --fault "at 2s gamepad/mouse unplug"
check "pulled out: the line drops and they are not listed; one comes back" usb_client '
s, t = connect(), connect()
assert attach(s, "1-3") and attach(t, "1-10")
assert s.recv(1) == b"" and t.recv(1) == b""
d = devlist(connect())
assert len(d) == 14 and "1-3" not in d and "1-10" not in d, d
begin = time.time()
while "1-3" not in d and time.time() - begin < 4:
    time.sleep(0.1)
    d = devlist(connect())
assert len(d) == 15 and "1-3" in d, d'
stop
start --fault "at 0s modbus/pdu1 exception code=6" --fault "at 0s power/pdu2 stick outlet=1"
sleep 0.1
check "a fault of the wire" client 'assert pdu(connect(), bytes.fromhex("0100000006"))[7:] == b"\x81\x06"'
port=$(field "$work/serve.json" 'r["endpoints"][1]["where"].split(":")[-1]')
check "a fault of the strip" client 'assert pdu(connect(), bytes.fromhex("0200000005"))[9:] == b"\x1e"'
stop

refuses() { # NUMBER ARGUMENTS...
	number=$1
	shift
	timeout 5 "$program" serve rooms/cabin.yaml --modbus-port 0 --usbip-port 0 --for 0.1 "$@" >"$work/out" 2>"$work/err"
	code=$?
	[ $code = 2 ] && grep -q "^BB$number: " "$work/err" || { echo "exit $code"; cat "$work/err"; return 1; }
}
token=0123456789abcdef0123456789abcdef
for address in 0.0.0.0 :: 192.0.2.1 128.0.0.1 localhost ""; do
	check "refused without a token: '$address'" refuses 1572 --bind "$address"
done
echo $token >"$work/token"
chmod 644 "$work/token"
check "a token others can read is refused" refuses 1572 --bind 0.0.0.0 --token-file "$work/token"
chmod 600 "$work/token"
ln -s token "$work/link"
check "a link is refused" refuses 1572 --bind 0.0.0.0 --token-file "$work/link"
echo 0123456789abcdef0123456789abcde >"$work/short"
chmod 600 "$work/short"
check "a short token is refused" refuses 1572 --bind 0.0.0.0 --token-file "$work/short"
check "no token file is refused" refuses 1572 --bind 0.0.0.0 --token-file "$work/none"
check "a bad fault is refused" refuses 1602 --fault "at 0s modbus/pdu1 fly"
check "a bad port is refused" refuses 1704 --modbus-port 70000
check "so is a bad one for USB/IP" refuses 1704 --usbip-port 70000

# Without a CAN there is none to be had, and with one no interface of that name; the guest of check-kernel has more.
check "a chain needs an interface" sh -c "'$program' serve rooms/cabin.yaml --modbus-port 0 --can nocan7 --for 0.1 2>&1 | grep -q '^BB153[01]: '"
"$program" serve rooms/desk.yaml --can nocan7 --for 0.1 >"$work/out" 2>"$work/err"
check "no chain, nothing for a CAN" sh -c "[ $? = 2 ] && grep -q '^BB1573: ' '$work/err'"
check "a fault of a wire nobody asked for" refuses 1604 --fault "at 0s can/chain twin"

start --token-file "$work/token"
check "without the token: hung up within a second or so" client '
s = connect()
s.sendall(struct.pack(">HHHB", 7, 0, 6, 1) + bytes.fromhex("0100000006"))
begin = time.time()
assert s.recv(300) == b"" and time.time() - begin < 5'
check "with a wrong token: hung up" client 's = connect(); s.sendall(b"0" * 32 + b"\n"); assert s.recv(300) == b""'
check "USB/IP without the token: hung up" usb_client '
s = connect()
s.sendall(struct.pack(">HHI", 0x0111, 0x8005, 0))
assert s.recv(300) == b""'
check "USB/IP with a wrong token: hung up" usb_client 's = connect(); s.sendall(b"0" * 32 + b"\n"); assert s.recv(300) == b""'
check "USB/IP with the token: served" usb_client 's = connect(); s.sendall(b"'$token'\n"); assert len(devlist(s)) == 16'
check "token and request in one packet: served" usb_client '
s = connect()
s.sendall(b"'$token'\n" + struct.pack(">HHI", 0x0111, 0x8005, 0))
assert whole(s, 12)[11] == 16'
check "with the token: served" client 's = connect(); s.sendall(b"'$token'\n"); assert good(s)'
stop
# Beyond loopback, in a network of its own that has no way out.
if unshare -n true 2>/dev/null; then
	unshare -n "$program" serve rooms/cabin.yaml --bind 0.0.0.0 --token-file "$work/token" --for 0.1 >"$work/out" 2>"$work/err"
	check "with a token another address is served" sh -c "[ $? = 0 ] && grep -q '0.0.0.0:1502' '$work/out' && grep -q '0.0.0.0:3240' '$work/out'"
else
	echo "SKIP: no network namespace can be made here: nothing is bound beyond loopback"
fi
"$program" serve rooms/standin.yaml --for 0.1 >"$work/out" 2>"$work/err"
check "a room without anything to serve says so" sh -c "[ $? = 2 ] && grep -q '^BB1573: ' '$work/err'"
finish
