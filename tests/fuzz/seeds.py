#!/usr/bin/env python3
"""Write the seeds of tests/fuzz/seeds.txt to FOLDER/TARGET/NAME: tests/fuzz/seeds.py FOLDER"""
import glob
import os
import re
import shutil
import sys


def value(text):
    if text.startswith('"'):
        assert text.endswith('"'), text
        return text[1:-1].encode("latin-1").decode("unicode_escape").encode("latin-1")
    out = b""
    for word in text.split():
        digits, _, times = word.partition("*")
        out += bytes.fromhex(digits) * int(times or 1)
    return out


def main(folder):
    target = None
    with open(os.path.join(os.path.dirname(__file__), "seeds.txt"), encoding="ascii") as lines:
        for line in lines:
            line = line.rstrip("\n")
            if not line or line.startswith("#"):
                continue
            section = re.fullmatch(r"\[(\w+)\]", line)
            if section:
                target = os.path.join(folder, section.group(1))
                os.makedirs(target, exist_ok=True)
                continue
            if line.startswith("@"):  # files of the tree
                for path in glob.glob(line[1:]):
                    shutil.copy(path, target)
                continue
            name, _, text = line.partition(" ")
            with open(os.path.join(target, name), "xb") as out:  # a name given twice is a mistake
                out.write(value(text.strip()))


main(sys.argv[1])
