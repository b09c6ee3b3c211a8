/*
 * sim/faults.c: the grammar of faults, their arguments, and the list of all verbs. Texts come from people and files,
 * so everything is bounded and checked here; planting is in sim/fault_plan.c.
 */
#include "sim/peer_ddcci.h"
#include "sim/peer_modbus.h"
#include "sim/peer_shutter.h"
#include "sim/sim.h"
#include "sim/world_impl.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define FAULT_FILE_MAX_BYTES (1 << 20)
#define TOKENS_MAX 16
#define LATEST_S 1e6

static const struct {
	const char *name;
	const struct sim_verb *verbs;
} classes[] = {
	{ "shutter", sim_shutter_verbs }, { "camera", sim_camera_verbs }, { "display", sim_display_verbs },
	{ "monitor", sim_monitor_verbs }, { "power", sim_power_verbs },   { "gamepad", sim_gamepad_verbs },
	{ "link", sim_link_verbs },       { "node", sim_node_verbs },     { "world", sim_viewer_verbs },
	/* of `serve`: the same devices' wires */
	{ "modbus", peer_modbus_verbs },  { "ddc", peer_ddcci_wire_verbs }, { "can", sim_chain_can_verbs },
};

const struct sim_verb *sim_fault_verb(size_t i, const char **class_out)
{
	for (size_t c = 0; c < BB_ARRAY_LEN(classes); c++)
		for (const struct sim_verb *v = classes[c].verbs; v->name; v++)
			if (!i--) {
				*class_out = classes[c].name;
				return v;
			}
	return NULL;
}

/* Arguments */

const char *sim_fault_arg(const struct sim_fault_args *args, const char *key)
{
	for (size_t i = 0; i < args->n; i++)
		if (!strcmp(args->arg[i].key, key))
			return args->arg[i].value;
	return NULL;
}

/* A plain decimal number and nothing else: strtod alone would take "nan", "inf" and "0x1p4". */
static bool decimal(const char *text, double *out)
{
	char *end;

	if (!*text || text[strspn(text, "0123456789.+-eE")])
		return false;
	*out = strtod(text, &end);
	return !*end && isfinite(*out);
}

bool sim_fault_number(const struct sim_fault_args *args, const char *key, double fallback, double *out)
{
	const char *value = sim_fault_arg(args, key);

	*out = fallback;
	return !value || decimal(value, out);
}

enum bb_status sim_fault_range(const struct sim_fault_args *args, const char *key, double fallback, double least,
                               double most, double *out, struct bb_error *err)
{
	const char *value = sim_fault_arg(args, key);

	if (!value && isnan(fallback))
		return bb_fail(err, BB_ERR_CONFIG, 1605, args->where, "%s=N is missing", key);
	if (!sim_fault_number(args, key, fallback, out))
		return bb_fail(err, BB_ERR_CONFIG, 1605, args->where, "%s=%.40s is no number", key, value);
	if (!(*out >= least && *out <= most))
		return bb_fail(err, BB_ERR_CONFIG, 1605, args->where, "%s=%.40s is outside %g..%g", key, value, least,
		               most);
	return BB_OK;
}

/* Does "[stage=ID] us=N" know this key, and is its value of that kind? */
static bool known_key(const char *spec, const char *key, bool *number)
{
	const size_t n = strlen(key);

	for (const char *p = spec; *p; p += strcspn(p, " ")) {
		p += strspn(p, " [");
		if (strncmp(p, key, n) || p[n] != '=')
			continue;
		*number = p[n + 1] == 'N' && !strchr("ABCDEFGHIJKLMNOPQRSTUVWXYZ", p[n + 2] ? p[n + 2] : ' ');
		return true;
	}
	return false;
}

static enum bb_status check_keys(const struct sim_fault *f, const struct sim_verb *v, const struct bb_where *where,
                                 struct bb_error *err)
{
	double value;
	bool number;

	for (size_t i = 0; i < f->args.n; i++) {
		const char *key = f->args.arg[i].key;
		if (!known_key(v->args, key, &number))
			return bb_fail(err, BB_ERR_CONFIG, 1605, where, "%s has no argument \"%s\" (it takes: %s)",
			               v->name, key, *v->args ? v->args : "none");
		if (number && !sim_fault_number(&f->args, key, 0, &value))
			return bb_fail(err, BB_ERR_CONFIG, 1605, where, "%s=%s is no number", key,
			               f->args.arg[i].value);
	}
	return BB_OK;
}

/* The grammar */

struct line {
	size_t n;
	char *token[TOKENS_MAX];
	char bytes[sizeof(((struct sim_fault *)0)->text)];
};

static enum bb_status tokenize(const char *text, struct line *line, const struct bb_where *where, struct bb_error *err)
{
	const size_t n = strlen(text);

	line->n = 0;
	if (n >= sizeof(line->bytes))
		return bb_fail(err, BB_ERR_CONFIG, 1601, where, "%zu bytes long, a fault has at most %zu", n,
		               sizeof(line->bytes) - 1);
	memcpy(line->bytes, text, n + 1);
	for (char *p = line->bytes; *p;) {
		while (*p == ' ' || *p == '\t')
			*p++ = '\0';
		if (!*p)
			break;
		if (line->n == TOKENS_MAX)
			return bb_fail(err, BB_ERR_CONFIG, 1601, where, "more than %d words", TOKENS_MAX);
		line->token[line->n++] = p;
		p += strcspn(p, " \t");
	}
	return BB_OK;
}

static bool time_of(const char *text, int64_t *out_ns)
{
	static const struct {
		const char *suffix;
		double ns;
	} units[] = { { "ms", 1e6 }, { "us", 1e3 }, { "s", 1e9 } };
	const size_t n = strlen(text);
	char number[32];
	double value;

	for (size_t i = 0; i < BB_ARRAY_LEN(units); i++) {
		const size_t suffix = strlen(units[i].suffix);
		if (n <= suffix || n - suffix >= sizeof(number) || strcmp(text + n - suffix, units[i].suffix))
			continue;
		memcpy(number, text, n - suffix);
		number[n - suffix] = '\0';
		if (!decimal(number, &value) || !(value >= 0 && value * units[i].ns <= LATEST_S * 1e9))
			return false;
		*out_ns = llround(value * units[i].ns);
		return true;
	}
	return false;
}

static enum bb_status parse_at(const struct line *line, struct sim_fault *f, const struct bb_where *where,
                               struct bb_error *err)
{
	if (line->n < 4 || strcmp(line->token[0], "at"))
		return bb_fail(err, BB_ERR_CONFIG, 1601, where, "\"%s\" does not read \"at TIME CLASS/ID VERB ...\"",
		               f->text);
	f->at_boot = !strcmp(line->token[1], "boot");
	if (!f->at_boot && !time_of(line->token[1], &f->at_ns))
		return bb_fail(err, BB_ERR_CONFIG, 1603, where, "\"%s\" is no time", line->token[1]);
	return BB_OK;
}

static enum bb_status parse_target(const char *target, struct sim_fault *f, const struct bb_where *where,
                                   struct bb_error *err)
{
	const char *slash = strchr(target, '/');
	const size_t n = slash ? (size_t)(slash - target) : 0;

	if (!n || !slash[1])
		return bb_fail(err, BB_ERR_CONFIG, 1601, where, "\"%s\" does not read CLASS/ID", target);
	if (n >= sizeof(f->class_name))
		return bb_fail(err, BB_ERR_CONFIG, 1602, where, "no class \"%.*s\"", (int)n, target);
	if (strlen(slash + 1) >= sizeof(f->id))
		return bb_fail(err, BB_ERR_CONFIG, 1604, where, "\"%s\": an id has at most %d bytes", slash + 1,
		               BB_ID_MAX - 1);
	memcpy(f->class_name, target, n);
	f->class_name[n] = '\0';
	memcpy(f->id, slash + 1, strlen(slash + 1) + 1);
	return BB_OK;
}

static enum bb_status parse_for(const struct line *line, size_t i, struct sim_fault *f, const struct bb_where *where,
                                struct bb_error *err)
{
	double frames;

	if (line->n == i + 1 && time_of(line->token[i], &f->for_ns) && f->for_ns > 0)
		return BB_OK;
	f->for_ns = BB_NEVER;
	if (line->n != i + 2 || (strcmp(line->token[i + 1], "frames") && strcmp(line->token[i + 1], "frame")) ||
	    !decimal(line->token[i], &frames) || !(frames >= 1 && frames <= 1e9) || frames != floor(frames))
		return bb_fail(err, BB_ERR_CONFIG, 1603, where, "\"%s%s%s\" after \"for\" is no duration",
		               i < line->n ? line->token[i] : "", i + 1 < line->n ? " " : "",
		               i + 1 < line->n ? line->token[i + 1] : "");
	f->for_frames = (int64_t)frames;
	return BB_OK;
}

static enum bb_status parse_arg(const char *token, struct sim_fault *f, const struct bb_where *where,
                                struct bb_error *err)
{
	const char *equals = strchr(token, '=');
	const size_t n = equals ? (size_t)(equals - token) : 0;

	if (!n || !equals[1] || n >= sizeof(f->args.arg[0].key) || strlen(equals + 1) >= sizeof(f->args.arg[0].value))
		return bb_fail(err, BB_ERR_CONFIG, 1605, where, "\"%s\" does not read key=value", token);
	if (f->args.n == SIM_FAULT_ARGS_MAX)
		return bb_fail(err, BB_ERR_CONFIG, 1605, where, "more than %d arguments", SIM_FAULT_ARGS_MAX);
	char *key = f->args.arg[f->args.n].key;
	memcpy(key, token, n);
	key[n] = '\0';
	if (sim_fault_arg(&f->args, key))
		return bb_fail(err, BB_ERR_CONFIG, 1605, where, "\"%s\" is given twice", key);
	memcpy(f->args.arg[f->args.n++].value, equals + 1, strlen(equals + 1) + 1);
	return BB_OK;
}

/* How many single-byte edits turn a into b; both are short names. */
static size_t edits(const char *a, const char *b)
{
	enum { LONGEST = 24 };
	const size_t na = strlen(a), nb = strlen(b);
	size_t row[LONGEST + 1];

	if (na > LONGEST || nb > LONGEST)
		return LONGEST;
	for (size_t j = 0; j <= nb; j++)
		row[j] = j;
	for (size_t i = 1; i <= na; i++) {
		size_t diagonal = row[0];
		row[0] = i;
		for (size_t j = 1; j <= nb; j++) {
			const size_t swap = diagonal + (a[i - 1] != b[j - 1]);
			const size_t least = row[j] < row[j - 1] ? row[j] + 1 : row[j - 1] + 1;
			diagonal = row[j];
			row[j] = swap < least ? swap : least;
		}
	}
	return row[nb];
}

static enum bb_status no_class(const struct sim_fault *f, const struct bb_where *where, struct bb_error *err)
{
	char known[128] = "";

	for (size_t c = 0; c < BB_ARRAY_LEN(classes); c++)
		snprintf(known + strlen(known), sizeof(known) - strlen(known), "%s%s", c ? ", " : "", classes[c].name);
	return bb_fail(err, BB_ERR_CONFIG, 1602, where, "no class \"%s\" (there are: %s)", f->class_name, known);
}

static enum bb_status no_verb(const struct sim_fault *f, const struct sim_verb *verbs, const struct bb_where *where,
                              struct bb_error *err)
{
	const char *nearest = NULL;
	char known[200] = "";
	size_t least = 4; /* further away is no slip of the finger */

	for (const struct sim_verb *v = verbs; v->name; v++) {
		const size_t d = edits(f->verb, v->name);
		if (d < least) {
			least = d;
			nearest = v->name;
		}
		snprintf(known + strlen(known), sizeof(known) - strlen(known), "%s%s", v == verbs ? "" : ", ", v->name);
	}
	return nearest ? bb_fail(err, BB_ERR_CONFIG, 1602, where, "%s has no verb \"%s\", did you mean \"%s\"? (%s)",
	                         f->class_name, f->verb, nearest, known)
	               : bb_fail(err, BB_ERR_CONFIG, 1602, where, "%s has no verb \"%s\" (%s)", f->class_name, f->verb,
	                         known);
}

static enum bb_status find_verb(const struct sim_fault *f, const struct sim_verb **out, const struct bb_where *where,
                                struct bb_error *err)
{
	for (size_t c = 0; c < BB_ARRAY_LEN(classes); c++) {
		if (strcmp(classes[c].name, f->class_name))
			continue;
		for (const struct sim_verb *v = classes[c].verbs; v->name; v++)
			if (!strcmp(v->name, f->verb)) {
				*out = v;
				return BB_OK;
			}
		return no_verb(f, classes[c].verbs, where, err);
	}
	return no_class(f, where, err);
}

static enum bb_status parse_line(const struct line *line, struct sim_fault *f, const struct sim_verb **verb,
                                 const struct bb_where *where, struct bb_error *err)
{
	enum bb_status status = parse_at(line, f, where, err);
	size_t i = 4;

	if (status == BB_OK)
		status = parse_target(line->token[2], f, where, err);
	if (status != BB_OK)
		return status;
	snprintf(f->verb, sizeof(f->verb), "%s", line->token[3]);
	status = find_verb(f, verb, where, err);
	for (; i < line->n && strcmp(line->token[i], "for") && status == BB_OK; i++)
		status = parse_arg(line->token[i], f, where, err);
	if (status == BB_OK && i < line->n)
		status = parse_for(line, i + 1, f, where, err);
	return status;
}

enum bb_status sim_fault_parse(const char *text, struct sim_fault *out, const struct bb_where *where,
                               struct bb_error *err)
{
	const struct sim_verb *verb = NULL;
	struct line line = { .n = 0 };
	struct sim_fault f = { .for_ns = BB_NEVER };

	*out = f;
	enum bb_status status = tokenize(text, &line, where, err);
	if (status != BB_OK)
		return status;
	snprintf(f.text, sizeof(f.text), "%s", text);
	status = parse_line(&line, &f, &verb, where, err);
	if (status != BB_OK || !verb)
		return status;
	status = check_keys(&f, verb, where, err);
	if (status != BB_OK)
		return status;
	f.args.where = where;
	status = verb->apply(NULL, &f.args, true, err);
	f.args.where = NULL; /* the caller's, and only for the messages above */
	if (status != BB_OK) /* a verb that said nothing still gets its number */
		return bb_fail(err, BB_ERR_CONFIG, 1605, where, "%s takes: %s", f.verb,
		               *verb->args ? verb->args : "nothing");
	*out = f;
	return BB_OK;
}

/* Files */

static enum bb_status read_all(const char *path, char *text, size_t *n_out, struct bb_error *err)
{
	const struct bb_where where = { path, 0, 0 };
	FILE *file = fopen(path, "rb");
	enum bb_status status = BB_OK;

	if (!file)
		return bb_fail(err, BB_ERR_CONFIG, 1001, &where, "%s", strerror(errno));
	*n_out = fread(text, 1, FAULT_FILE_MAX_BYTES + 1, file);
	text[*n_out] = '\0';
	if (ferror(file))
		status = bb_fail(err, BB_ERR_CONFIG, 1002, &where, "%s", strerror(errno));
	else if (*n_out > FAULT_FILE_MAX_BYTES)
		status = bb_fail(err, BB_ERR_CONFIG, 1003, &where, "more than %d bytes", FAULT_FILE_MAX_BYTES);
	fclose(file);
	return status;
}

/* Ends a line at its comment or newline, trims it, and returns what follows (NULL: the end). */
static char *next_line(char *line, char *end)
{
	char *stop = memchr(line, '\n', (size_t)(end - line));
	char *next = stop ? stop + 1 : NULL;
	char *last = stop ? stop : end;

	*last = '\0';
	line[strcspn(line, "#")] = '\0';
	for (size_t n = strlen(line); n && strchr(" \t\r", line[n - 1]); n--)
		line[n - 1] = '\0';
	return next;
}

static enum bb_status parse_text(char *text, size_t n, const char *path, struct sim_fault **faults, size_t *n_out,
                                 struct bb_error *err)
{
	struct bb_where where = { path, 1, 1 };
	size_t cap = 0;

	if (memchr(text, '\0', n))
		return bb_fail(err, BB_ERR_CONFIG, 1601, &(struct bb_where){ path, 0, 0 }, "a NUL byte in a text file");
	for (char *line = text, *next; line; line = next, where.line++) {
		next = next_line(line, text + n);
		char *start = line + strspn(line, " \t");
		if (!*start)
			continue;
		if (*n_out == SIM_FAULTS_MAX)
			return bb_fail(err, BB_ERR_CONFIG, 1607, &where, "a run has at most %d", SIM_FAULTS_MAX);
		if (!sim_grow((void **)faults, sizeof(**faults), *n_out, &cap, SIM_FAULTS_MAX))
			return bb_fail(err, BB_ERR_NOMEM, 1702, &where, "%zu faults", *n_out);
		where.column = 1 + (int)(start - line);
		const enum bb_status status = sim_fault_parse(start, &(*faults)[*n_out], &where, err);
		if (status != BB_OK)
			return status;
		++*n_out;
	}
	return BB_OK;
}

enum bb_status sim_fault_file(const char *path, struct sim_fault **out, size_t *n_out, struct bb_error *err)
{
	char *text = malloc(FAULT_FILE_MAX_BYTES + 2);
	size_t n = 0;

	*out = NULL;
	*n_out = 0;
	if (!text)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "reading faults");
	enum bb_status status = read_all(path, text, &n, err);
	if (status == BB_OK)
		status = parse_text(text, n, path, out, n_out, err);
	free(text);
	if (status != BB_OK) {
		free(*out);
		*out = NULL;
		*n_out = 0;
	}
	return status;
}
