#!/usr/bin/env python3
"""Mutants of the safety files, each of which tests/test_safety.c must kill.

Every condition (of if, for and ?:, and each operand of && and ||, and what a bool is set to by a comparison) is negated,
forced true and forced false; every constant is one more and one less. Inside functions all mutants of a file are compiled
at once, behind a number that the program is given; what must be constant for the compiler (tables, #define) is compiled
mutant by mutant. A mutant that lives must stand in tests/safety-mutants.txt with its reason, and one that stands there
must live. Usage: tests/safety-mutants.py [-v]
"""
import os
import re
import subprocess
import sys
import tempfile

FILES = ["hal/safety.c", "hal/safe_state.c", "hal/lc_guard.c"]
SKIP = os.path.join("tests", "safety-mutants.txt")
TEST = "tests/test_safety.c"
CC = ["gcc", "-std=gnu11", "-O0", "-w", "-I."]
NUMBER = re.compile(r"(?<![\w.\"%])(\d+(?:\.\d+)?(?:e-?\d+)?)(?![\w.])")


def blank(text):
    """Comments, strings and what only a test is built with as spaces, so that positions stay."""
    def spaces(m):
        return re.sub(r"[^\n]", " ", m.group())
    text = re.sub(r"^#ifdef BB_SAFE_UNLATCHED.*?^#endif", spaces, text, flags=re.S | re.M)
    return re.sub(r'/\*.*?\*/|//[^\n]*|"(?:\\.|[^"\\])*"|^[ \t]*#[^\n]*', spaces, text, flags=re.S | re.M)


def closing(text, at):
    depth = 0
    for i in range(at, len(text)):
        depth += {"(": 1, ")": -1}.get(text[i], 0)
        if depth == 0:
            return i
    raise SystemExit("unbalanced brackets")


def split(text, begin, end, words):
    """Parts of [begin, end) between operators of the outermost level."""
    parts, depth, start, i = [], 0, begin, begin
    while i < end:
        c = text[i]
        depth += {"(": 1, "[": 1, "{": 1, ")": -1, "]": -1, "}": -1}.get(c, 0)
        word = next((w for w in words if depth == 0 and text.startswith(w, i)), None)
        if word:
            parts.append((start, i))
            i += len(word)
            start = i
        else:
            i += 1
    return parts + [(start, end)]


def trim(text, span):
    b, e = span
    while b < e and text[b].isspace():
        b += 1
    while e > b and text[e - 1].isspace():
        e -= 1
    return b, e


def functions(text):
    """Spans of function bodies: braces in column 0."""
    return [(m.start(), text.index("\n}", m.start()) + 2) for m in re.finditer(r"^\{$", text, re.M)]


def operands(text, span, out):
    """A condition and, through brackets and negations, every operand of its && and ||."""
    b, e = trim(text, span)
    if b >= e:
        return
    out.add((b, e))
    for word in ("||", "&&"):
        parts = split(text, b, e, [word])
        if len(parts) > 1:
            for p in parts:
                operands(text, p, out)
            return
    inner = b
    while inner < e and text[inner] == "!":
        inner += 1
    if inner < e and text[inner] == "(" and closing(text, inner) == e - 1:
        operands(text, (inner + 1, e - 1), out)


def expression_before(text, at):
    """Where the condition of a ?: begins."""
    depth, i = 0, at - 1
    while i >= 0:
        c = text[i]
        if c in ")]":
            depth += 1
        elif c in "([":
            if depth == 0:
                return i + 1
            depth -= 1
        elif depth == 0 and c in ";{},?:":
            return i + 1
        elif depth == 0 and c == "=" and text[i - 1] not in "=!<>" and text[i + 1] != "=":
            return i + 1
        elif depth == 0 and text[i - 6:i] == "return":
            return i
        i -= 1
    return 0


def conditions(text, bodies):
    out = set()
    for b, e in bodies:
        for m in re.finditer(r"\bif \(", text[b:e]):
            at = b + m.end() - 1
            operands(text, (at + 1, closing(text, at)), out)
        for m in re.finditer(r"\bfor \(", text[b:e]):
            at = b + m.end() - 1
            operands(text, split(text, at + 1, closing(text, at), [";"])[1], out)
        for m in re.finditer(r"\?", text[b:e]):
            operands(text, (expression_before(text, b + m.start()), b + m.start()), out)
        for m in re.finditer(r"\bbool \w+ = ([^;]*);", text[b:e]):
            operands(text, (b + m.start(1), b + m.end(1)), out)
        for m in re.finditer(r"\breturn ([^;?]* (?:==|!=|<=|>=|<|>|&&|\|\|) [^;?]*);", text[b:e]):
            if "?" not in m.group():
                operands(text, (b + m.start(1), b + m.end(1)), out)
        for m in re.finditer(r" = ([^;={}?]* (?:==|!=|<=|>=|<|>|&&|\|\|) [^;={}?]*);", text[b:e]):
            operands(text, (b + m.start(1), b + m.end(1)), out)
    return sorted(out)


def line_of(text, at):
    return text.count("\n", 0, at) + 1


def literal(number, by):
    return "(%s %+d)" % (number, by)


class File:
    def __init__(self, path):
        self.path = path
        self.text = open(path).read()
        self.plain = blank(self.text)
        self.bodies = functions(self.plain)
        self.inside, self.outside = [], []  # (name, [(begin, end, replacement)])
        for b, e in conditions(self.plain, self.bodies):
            words = self.text[b:e]
            for name, new in (("negated", "!(%s)" % words), ("true", "(((void)(%s)), 1)" % words),
                              ("false", "(((void)(%s)), 0)" % words)):
                self.inside.append((self.name(b, "'%s' %s" % (" ".join(words.split()), name)), b, e, new))
        for m in NUMBER.finditer(self.plain):
            where = any(b <= m.start() < e for b, e in self.bodies)
            if self.in_table(m.start()):
                where = False
            for by in (1, -1):
                name = self.name(m.start(), "%s %+d" % (m.group(), by))
                (self.inside if where else self.outside).append((name, m.start(), m.end(), literal(m.group(), by)))
        for m in re.finditer(r"^#define \w+ (?:INT64_C\()?(\d+)", self.text, re.M):
            for by in (1, -1):
                name = self.name(m.start(), "%s %+d" % (m.group(1), by))
                self.outside.append((name, m.start(1), m.end(1), str(int(m.group(1)) + by)))

    def in_table(self, at):
        """Array sizes and static tables must be constant."""
        begin = self.plain.rfind(";", 0, at)
        return re.search(r"\bstatic const\b", self.plain[begin + 1:at]) is not None and \
            not any(b <= at < e for b, e in self.bodies)

    def name(self, at, what):
        line = " ".join(self.text.splitlines()[line_of(self.text, at) - 1].split())
        return "%s: %s: %s" % (self.path, line, what)

    def schema(self, first):
        """All inside mutants at once: the innermost expression first, so that outer ones hold inner ones."""
        table = {}
        for i, (name, b, e, new) in enumerate(self.inside):
            table.setdefault((b, e), []).append((first + i, new))
        return "extern int mutant_number;\n" + self.render(table, 0, len(self.text))

    def render(self, table, begin, end):
        """The text of [begin, end) with every span in the table made a choice by number."""
        out, at = "", begin
        spans = sorted((s for s in table if begin <= s[0] and s[1] <= end), key=lambda s: (s[0], -s[1]))
        while spans:
            b, e = spans[0]
            inner = {s: v for s, v in table.items() if b <= s[0] and s[1] <= e and s != (b, e)}
            plain = self.render(inner, b, e)
            choice = plain
            for number, new in table[(b, e)]:
                choice = "(mutant_number == %d ? (%s) : (%s))" % (number, new, choice)
            out += self.text[at:b] + choice
            at = e
            spans = [s for s in spans[1:] if s[0] >= e]
        return out + self.text[at:end]

    def alone(self, mutant):
        name, b, e, new = mutant
        return self.text[:b] + new + self.text[e:]


def build(dir, sources, out):
    paths = []
    for i, text in enumerate(sources):
        path = os.path.join(dir, "m%d.c" % i)
        with open(path, "w") as f:
            f.write(text)
        paths.append(path)
    with open(os.path.join(dir, "number.c"), "w") as f:
        f.write('#include <stdlib.h>\nint mutant_number = -1;\n'
                '__attribute__((constructor)) static void number(int argc, char **argv)\n'
                '{ if (argc > 1) mutant_number = atoi(argv[1]); }\n')
    subprocess.run(CC + ["-o", out, TEST, os.path.join(dir, "number.c"), "hal/status.c"] + paths + ["-lcmocka", "-lm"],
                   check=True)


def killed(program, number):
    try:
        return subprocess.run([program, str(number)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                              timeout=20).returncode != 0
    except subprocess.TimeoutExpired:
        return True


def main():
    files = [File(p) for p in FILES]
    originals = [f.text for f in files]
    lived, n = [], 0
    with tempfile.TemporaryDirectory() as dir:
        program = os.path.join(dir, "test")
        first, names, schemas = 0, [], []
        for f in files:
            schemas.append(f.schema(first))
            names += [m[0] for m in f.inside]
            first += len(f.inside)
        build(dir, schemas, program)
        if killed(program, -1):
            raise SystemExit("the tests fail without a mutant")
        for i, name in enumerate(names):
            n += 1
            if not killed(program, i):
                lived.append(name)
        for i, f in enumerate(files):
            for mutant in f.outside:
                n += 1
                build(dir, originals[:i] + [f.alone(mutant)] + originals[i + 1:], program)
                if not killed(program, -1):
                    lived.append(mutant[0])
    allowed = {}
    for line in open(SKIP) if os.path.exists(SKIP) else []:
        if line.strip() and not line.startswith("#"):
            name, _, reason = line.strip().partition(" -- ")
            allowed[name] = reason
    bad = [m for m in lived if not allowed.get(m)]
    stale = [m for m in allowed if m not in lived]
    for m in bad:
        print("lives: %s" % m)
    for m in stale:
        print("listed and dead: %s" % m)
    print("%d mutants of the safety files, %d killed, %d live with a reason" % (n, n - len(lived), len(lived) - len(bad)))
    return 1 if bad or stale else 0


if __name__ == "__main__":
    sys.exit(main())
