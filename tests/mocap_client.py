#!/usr/bin/env python3
"""
Reads streams of tracking as other people's programs do, with nothing but Python's own library. Written from the layouts in
docs/streaming.md's references, not from our C: what both get wrong would have to be wrong twice.

mocap_client.py natnet PORT SECONDS | vrpn PORT SENDER[,SENDER] SECONDS | lob PORT SENDER SECONDS |
both NATNET-PORT,VRPN-PORT SENDER SECONDS: prints JSON.
"""
import json
import socket
import struct
import sys
import threading
import time


class Bytes:
    def __init__(self, data):
        self.data, self.at = data, 0

    def take(self, form):
        form = "<" + form
        values = struct.unpack_from(form, self.data, self.at)
        self.at += struct.calcsize(form)
        return values if len(values) > 1 else values[0]

    def text(self):
        end = self.data.index(b"\0", self.at)
        value = self.data[self.at:end].decode()
        self.at = end + 1
        return value


# ---- NatNet 3.0 ----

def natnet_frame(b):
    f = {"number": b.take("i"), "sets": {}, "bodies": {}, "markers": []}
    for _ in range(b.take("i")):
        name = b.text()
        f["sets"][name] = [b.take("3f") for _ in range(b.take("i"))]
    f["unlabelled"] = [b.take("3f") for _ in range(b.take("i"))]
    for _ in range(b.take("i")):
        ident = b.take("i")
        at, turn, error, params = b.take("3f"), b.take("4f"), b.take("f"), b.take("h")
        f["bodies"][ident] = {"at": at, "q": turn, "error": error, "tracked": bool(params & 1)}
    assert b.take("i") == 0, "skeletons"
    for _ in range(b.take("i")):
        ident, at, size, params, residual = b.take("i"), b.take("3f"), b.take("f"), b.take("h"), b.take("f")
        f["markers"].append({"body": ident >> 16, "marker": ident & 0xffff, "at": at, "size": size, "params": params})
    assert b.take("i") == 0 and b.take("i") == 0, "force plates, devices"
    f["timecode"] = b.take("II")
    f["timestamp"], f["mid"], f["received"], f["sent"], f["params"] = b.take("d"), b.take("Q"), b.take("Q"), b.take("Q"), b.take("H")
    assert b.take("i") == 0 and b.at == len(b.data), "the end of data ends it"
    return f


def natnet_models(b):
    models = []
    for _ in range(b.take("i")):
        kind = b.take("i")
        m = {"kind": kind, "name": b.text()}
        if kind == 1:
            m["id"], m["parent"] = b.take("ii")
            b.take("3f")
            n = b.take("i")
            m["markers"] = [b.take("3f") for _ in range(n)]
            assert all(b.take("i") == 0 for _ in range(n))
        else:
            m["markers"] = [b.text() for _ in range(b.take("i"))]
        models.append(m)
    assert b.at == len(b.data)
    return models


class NatNet:
    def __init__(self, port):
        self.to = ("127.0.0.1", port)
        self.s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.s.settimeout(1)

    def ask(self, ident, payload, wanted):
        """Again and again: the machine may be busy, and datagrams may be lost."""
        for _ in range(20):
            self.say(ident, payload)
            end = time.monotonic() + 1
            try:
                while time.monotonic() < end:
                    got, b = self.hear(wanted, 7)
                    if got == wanted:
                        return b
            except socket.timeout:
                pass
        raise AssertionError("no answer to %d" % ident)

    def say(self, ident, payload=b""):
        self.s.sendto(struct.pack("<HH", ident, len(payload)) + payload, self.to)

    def hear(self, *wanted):
        while True:
            data = self.s.recv(65535)
            ident, n = struct.unpack("<HH", data[:4])
            assert n == len(data) - 4, "its own length"
            if ident in wanted:
                return ident, Bytes(data[4:])


def natnet(port, seconds, meanwhile=None):
    c = NatNet(port)
    b = c.ask(0, b"Python".ljust(256, b"\0") + bytes([1, 0, 0, 0, 3, 0, 0, 0]), 1)
    name = b.data[:256].split(b"\0")[0].decode()
    info = {"name": name, "natnet": list(b.data[260:264]), "hz": struct.unpack_from("<Q", b.data, 264)[0],
            "data_port": struct.unpack_from("<H", b.data, 272)[0], "bytes": len(b.data)}
    models = natnet_models(c.ask(4, b"", 5))
    echo = c.ask(12, struct.pack("<Q", 4711), 13).take("QQ")
    rate = c.ask(2, b"FrameRate\0", 3).take("f")
    c.ask(2, b"Nonsense\0", 0x100)
    c.ask(6, b"", 7)
    c.s.settimeout(3)
    frames, end, alive = [], time.monotonic() + seconds, 0
    if meanwhile:
        meanwhile.start()
    while time.monotonic() < end or (meanwhile and meanwhile.is_alive()) or (len(frames) < 15 and time.monotonic() < end + 10):
        if time.monotonic() > alive:
            c.say(10)
            alive = time.monotonic() + 1
        try:
            f = natnet_frame(c.hear(7)[1])
        except socket.timeout:  # they are gone
            break
        if not frames or f["number"] != frames[-1]["number"]:  # one comes twice: it was asked for
            frames.append(f)
    c.say(9)
    return {"server": info, "models": models, "echo": echo[0], "rate": rate, "frames": frames}


# ---- VRPN ----

def vrpn_read(s, n):
    data = b""
    while len(data) < n:
        piece = s.recv(n - len(data))
        assert piece, "they hung up"
        data += piece
    return data


def vrpn_message(s):
    n, sec, usec, sender, kind, seq = struct.unpack(">6i", vrpn_read(s, 24))
    assert 24 <= n < 4096
    body = vrpn_read(s, (n - 24 + 7) // 8 * 8)
    assert not any(body[n - 24:]), "padding"
    return sec + usec * 1e-6, sender, kind, seq, body[:n - 24]


def vrpn_say(s, sender, kind, payload=b""):
    s.sendall(struct.pack(">6i", 24 + len(payload), 1, 0, sender, kind, 0) + payload + bytes(-len(payload) % 8))


def vrpn_describe(s, kind, ident, name):
    vrpn_say(s, ident, kind, struct.pack(">i", len(name) + 1) + name.encode() + b"\0")


def vrpn_talk(s, wanted, seconds):
    s.settimeout(10)
    cookie = vrpn_read(s, 24)
    assert cookie[:14] == b"vrpn: ver. 07." and cookie[18:] == b"0" + bytes(5), cookie
    s.sendall(b"vrpn: ver. 07.33  0" + bytes(5))  # an older one than theirs
    vrpn_describe(s, -2, 5, "vrpn_Base ping_message")
    for i, name in enumerate(wanted):
        vrpn_describe(s, -1, 10 + i, name)
        vrpn_say(s, 10 + i, 5)
    vrpn_say(s, 12345, -3, b"127.0.0.1\0")
    senders, types, poses, speeds, pongs, last = {}, {}, [], [], set(), -1
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        at, sender, kind, seq, body = vrpn_message(s)
        assert seq == last + 1, "sequence"
        last = seq
        if kind in (-1, -2):
            n = struct.unpack_from(">i", body)[0]
            assert len(body) == 4 + n and body[-1] == 0
            (senders if kind == -1 else types)[sender] = body[4:-1].decode()
        elif types[kind] == "vrpn_Tracker Pos_Quat":
            v = struct.unpack(">ii7d", body)
            assert v[0] == 0 and v[1] == 0
            poses.append({"at": at, "sender": senders[sender], "p": v[2:5], "q": v[5:9]})
        elif types[kind] == "vrpn_Tracker Velocity":
            v = struct.unpack(">ii8d", body)
            speeds.append({"at": at, "sender": senders[sender], "v": v[2:5], "dt": v[9]})
        elif types[kind] == "vrpn_Base pong_message":
            pongs.add(senders[sender])
    vrpn_say(s, 0, -5)
    return {"cookie": cookie.hex(), "senders": sorted(senders.values()), "poses": poses, "velocities": speeds, "pongs": sorted(pongs)}


def vrpn(port, names, seconds):
    return vrpn_talk(socket.create_connection(("127.0.0.1", port), 5), names.split(","), seconds)


def lob(port, names, seconds):
    listener = socket.create_server(("127.0.0.1", 0))
    listener.settimeout(5)
    u = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    u.sendto(b"127.0.0.1 %d\0" % listener.getsockname()[1], ("127.0.0.1", port))
    return vrpn_talk(listener.accept()[0], names.split(","), seconds)


def both(ports, names, seconds):
    """At one time, so that they hear the same frames."""
    v = {}
    t = threading.Thread(target=lambda: v.update(vrpn(ports[1], names, seconds)))
    n = natnet(ports[0], seconds, t)
    t.join()
    return {"n": n, "v": v}


if __name__ == "__main__":
    how = sys.argv[1]
    where = [int(p) for p in sys.argv[2].split(",")] if how == "both" else int(sys.argv[2])
    if how == "natnet":
        json.dump(natnet(where, float(sys.argv[3])), sys.stdout)
    else:
        json.dump({"vrpn": vrpn, "lob": lob, "both": both}[how](where, sys.argv[3], float(sys.argv[4])), sys.stdout)
