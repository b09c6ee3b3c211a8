#!/bin/sh
# tests/check-layers.sh [ROOT]: holds the rules of ROOT/tests/layers.txt over the sources below ROOT (default: here).
# Prints "file:line: rule: what" for each break. Exit 0: none; 1: some; 2: nothing could be checked.
set -u
cd "${1:-.}" || exit 2
rules=tests/layers.txt
[ -r "$rules" ] || { echo "check-layers: no $rules here" >&2; exit 2; }

wings=
for d in hal drivers sim sync render bench tests; do
	[ -d "$d" ] && wings="$wings $d"
done
[ -n "$wings" ] || { echo "check-layers: no source folders here" >&2; exit 2; }

# shellcheck disable=SC2086
find $wings -type f \( -name '*.c' -o -name '*.h' -o -name '*.def' -o -name '*.inc' -o -name '*.cc' -o -name '*.cpp' \) | LC_ALL=C sort |
LC_ALL=C awk -v rules="$rules" '
function broken(line, rule, text) { printf "%s:%d: %s: %s\n", file, line, rule, text; n_broken++ }
function starts(s, prefix) { return substr(s, 1, length(prefix)) == prefix }

# "drivers/*_wire.h" stands for any one name; anything else is a beginning.
function matches(path, pattern,    star, head, tail) {
	star = index(pattern, "*")
	if (!star) return starts(path, pattern)
	head = substr(pattern, 1, star - 1); tail = substr(pattern, star + 1)
	if (length(path) < length(head) + length(tail) || !starts(path, head)) return 0
	if (substr(path, length(path) - length(tail) + 1) != tail) return 0
	return index(substr(path, length(head) + 1, length(path) - length(head) - length(tail)), "/") == 0
}

function read_rules(    line, f, n, i) {
	while ((getline line < rules) > 0) {
		n_line++
		sub(/[ \t]*#.*/, "", line)
		n = split(line, f, /[ \t]+/)
		if (n && f[1] == "") { for (i = 1; i < n; i++) f[i] = f[i + 1]; n-- }
		if (!n || line == "") continue
		if (f[1] == "may" && n >= 3) {
			known[f[2]] = 1
			for (i = 3; i <= n; i++) may[f[2], ++n_may[f[2]]] = f[i]
		} else if (f[1] == "only" && n >= 3) {
			only[++n_only] = f[2]
			for (i = 3; i <= n; i++) only_from[n_only, ++n_only_from[n_only]] = f[i]
		} else if (f[1] == "vendor" && n == 4) {
			vendor[++n_vendor] = f[2]; vendor_in[n_vendor] = f[3]; vendor_most[n_vendor] = f[4]
		} else if (f[1] == "word" && n == 3) {
			word[++n_word] = f[2]; word_in[n_word] = f[3]
		} else {
			printf "%s:%d: this rule is malformed\n", rules, n_line; bad_rules = 1
		}
	}
	if (!n_line) bad_rules = 1
}

function may_include(wing, header,    i) {
	for (i = 1; i <= n_may[wing]; i++)
		if (may[wing, i] == "all" || matches(header, may[wing, i])) return 1
	return 0
}

function check_only(line, header,    i, k, from, own) {
	for (i = 1; i <= n_only; i++) {
		if (!matches(header, only[i])) continue
		for (k = 1; k <= n_only_from[i]; k++) {
			from = only_from[i, k]
			own = header; sub(/_driver\.h$/, ".c", own)
			if (from == "hal/=.c" ? file == own : starts(file, from)) break
		}
		if (k > n_only_from[i]) broken(line, "driver-header", header " is not for " file)
	}
}

function check_project(line, header,    wing) {
	wing = header; sub(/\/.*/, "", wing)
	if (!(wing in known) || index(header, "/") == 0 || header ~ /\/\.\.\//) {
		broken(line, "path", "\"" header "\" is not written from the root of the project")
		return
	}
	if (!may_include(my_wing, header)) broken(line, "layer", my_wing "/ may not include " header)
	check_only(line, header)
}

function starts_any(s, prefixes,    i, n, p) {
	n = split(prefixes, p, ",")
	for (i = 1; i <= n; i++) if (starts(s, p[i])) return 1
	return 0
}

function check_vendor(line, header,    i) {
	for (i = 1; i <= n_vendor; i++) {
		if (!starts(header, vendor[i]) || my_wing == "tests") continue
		if (!starts_any(file, vendor_in[i]))
			broken(line, "vendor", "<" header "> belongs below " vendor_in[i])
		else if (!((i, file) in uses)) {
			uses[i, file] = 1
			n_uses[i]++
			where[i] = where[i] (where[i] == "" ? "" : ", ") file
			if (vendor_most[i] != "-" && n_uses[i] > vendor_most[i] + 0)
				broken(line, "vendor", "<" header "> is already included elsewhere: " where[i])
		}
	}
}

function check_include(line, text,    header) {
	sub(/^[ \t]*#[ \t]*(include_next|include|import)[ \t]*/, "", text)
	if (text ~ /^"/) {
		header = substr(text, 2); sub(/".*/, "", header)
		check_project(line, header)
	} else if (text ~ /^</) {
		header = substr(text, 2); sub(/>.*/, "", header)
		if (starts(header, "hal/") || starts(header, "drivers/") || starts(header, "sim/") ||
		    starts(header, "sync/") || starts(header, "render/") || starts(header, "bench/"))
			check_project(line, header)
		else
			check_vendor(line, header)
	} else
		broken(line, "path", "the header of an #include must be written out")
}

function check_words(line, text,    i, w, call, rest, at, before, after) {
	for (i = 1; i <= n_word; i++) {
		w = word[i]; call = 0
		if (substr(w, length(w)) == "(") { call = 1; w = substr(w, 1, length(w) - 1) }
		if (!index(text, w) || (word_in[i] != "-" && starts(file, word_in[i]))) continue
		rest = text; before = " "
		while ((at = index(rest, w)) > 0) {
			if (at > 1) before = substr(rest, at - 1, 1)
			after = substr(rest, at + length(w))
			if (before !~ /[A-Za-z0-9_]/ && after !~ /^[A-Za-z0-9_]/ && (!call || after ~ /^[ \t]*\(/)) {
				broken(line, "word", w (word_in[i] == "-" ? " is used nowhere" : " is used in " word_in[i] " only"))
				break
			}
			before = substr(w, length(w), 1)
			rest = after
		}
	}
}

# The line without comments, and without the insides of strings and characters; in_comment carries over.
function bare(text, keep_strings,    out, c, two, quote) {
	out = ""; quote = ""
	while (text != "") {
		c = substr(text, 1, 1); two = substr(text, 1, 2)
		if (in_comment) {
			if (two == "*/") { in_comment = 0; out = out " "; text = substr(text, 3) } else text = substr(text, 2)
		} else if (quote != "") {
			if (c == "\\") { text = substr(text, 3); continue }
			if (c == quote) { quote = ""; out = out c } else if (keep_strings) out = out c
			text = substr(text, 2)
		} else if (two == "/*") { in_comment = 1; text = substr(text, 3) }
		else if (two == "//") text = ""
		else {
			if (c == "\"" || c == "\047") quote = c
			out = out c
			text = substr(text, 2)
		}
	}
	return out
}

function check_file(    raw, line, first, text, was) {
	my_wing = file; sub(/\/.*/, "", my_wing)
	in_comment = 0; line = 0
	while ((getline raw < file) > 0) {
		first = ++line
		while (raw ~ /\\$/ && (getline text < file) > 0) { line++; raw = substr(raw, 1, length(raw) - 1) text }
		was = in_comment
		text = bare(raw, 0)
		if (text ~ /^[ \t]*#[ \t]*(include|import)/) {
			in_comment = was
			check_include(first, bare(raw, 1))
		} else if (my_wing != "tests")
			check_words(first, text)
	}
	close(file)
	n_files++
}

BEGIN { read_rules() }
{ file = $0; if (!bad_rules) check_file() }
END {
	if (bad_rules || !n_files) { print "check-layers: nothing could be checked" > "/dev/stderr"; exit 2 }
	if (n_broken) { printf "check-layers: %d breaks in %d files\n", n_broken, n_files; exit 1 }
	printf "check-layers: %d files keep to their layers\n", n_files
}'
