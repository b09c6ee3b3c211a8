#!/usr/bin/env python3
"""Count branches and regions of a parser in llvm-cov's export: tests/fuzz/coverage.py [1] TARGET JSON"""
import json
import os
import sys


def counted(target):
    """Files of the parser, and the functions in them that do not count."""
    files, without, inside = [], set(), False
    with open("tests/fuzz/targets.txt", encoding="ascii") as table:
        for line in table:
            words = line.split("#")[0].split(":")[0].split()
            if not words:
                continue
            if words[0] == "without":
                without |= set(words[1:]) if inside else set()
                continue
            inside = words[0] == target
            if inside:
                files = words[2:]
    return files, without


def main(verbose, target, path):
    files, without = counted(target)
    with open(path, encoding="utf-8") as text:
        functions = json.load(text)["data"][0]["functions"]
    names, total = set(), [0, 0, 0, 0]
    for f in functions:
        name = f["name"].split(":")[-1]
        file = os.path.relpath(f["filenames"][0])
        if file not in files:
            continue
        names.add(name)
        if name in without:
            continue
        regions = [r for r in f["regions"] if r[7] == 0]
        outcomes = [(b[0], c) for b in f["branches"] for c in (b[4], b[5])]
        hit = sum(1 for r in regions if r[4])
        taken = sum(1 for _, c in outcomes if c)
        for i, n in enumerate((len(outcomes), taken, len(regions), hit)):
            total[i] += n
        if verbose and (taken < len(outcomes) or hit < len(regions)):
            lines = sorted({line for line, c in outcomes if not c} | {r[0] for r in regions if not r[4]})
            print(f"{file}: {name}: {taken}/{len(outcomes)} branches, {hit}/{len(regions)} regions, lines {lines}")
    for name in sorted(without - names):
        sys.exit(f"targets.txt: {target}: there is no function {name} in {' '.join(files)}")
    percent = [100 * total[i + 1] / total[i] if total[i] else 100.0 for i in (0, 2)]
    print(f"{total[0]} {total[1]} {percent[0]:.1f} {total[2]} {total[3]} {percent[1]:.1f}")


main(len(sys.argv) > 3, *sys.argv[-2:])
