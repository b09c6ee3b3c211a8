/* sim/pad_script.c: event texts of gamepads, parsed or generated; see sim/sim_gamepad.h. */
#include "sim/sim_gamepad.h"

#include "sim/world.h"

#include <ctype.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define BYTES_MAX ((size_t)256 * 1024)
#define EVENTS_MAX 8192
#define WORDS_MAX 10
#define T_MAX_S 86400.0
#define RAMP_MAX_S 600.0
#define GENERATED_S 600.0

struct key { /* of one axis: values between keys are linear, after the last they hold */
	int64_t t_ns;
	double value;
};
struct track {
	size_t n, cap;
	struct key *key;
};
struct change { /* buttons and battery hold from t on */
	int64_t t_ns;
	uint32_t buttons;
	double battery;
};

struct sim_pad_script {
	struct track axis[BB_PAD_AXES];
	size_t n_changes, cap_changes;
	struct change *change;
	size_t n_events;
	int64_t last_ns;
};

void sim_pad_script_free(struct sim_pad_script *s)
{
	if (!s)
		return;
	for (size_t i = 0; i < BB_PAD_AXES; i++)
		free(s->axis[i].key);
	free(s->change);
	free(s);
}

static void *grown(void *array, size_t n, size_t *cap, size_t each)
{
	if (n < *cap)
		return array;
	const size_t more = *cap ? 2 * *cap : 32; /* EVENTS_MAX bounds it */
	void *larger = realloc(array, more * each);
	if (!larger)
		return NULL;
	memset((char *)larger + *cap * each, 0, (more - *cap) * each);
	*cap = more;
	return larger;
}

/* How many keys lie at or before t. */
static size_t keys_until(const struct track *tr, int64_t t_ns)
{
	size_t lo = 0, hi = tr->key ? tr->n : 0;

	while (lo < hi) {
		const size_t mid = (lo + hi) / 2;
		if (tr->key[mid].t_ns <= t_ns)
			lo = mid + 1;
		else
			hi = mid;
	}
	return lo;
}

static double track_at(const struct track *tr, int64_t t_ns)
{
	const size_t n = keys_until(tr, t_ns);

	if (!n || !tr->key)
		return 0;
	const struct key *k = &tr->key[n - 1];
	if (n == tr->n)
		return k->value;
	return k->value + (k[1].value - k->value) * (double)(t_ns - k->t_ns) / (double)(k[1].t_ns - k->t_ns);
}

static enum bb_status add_key(struct track *tr, int64_t t_ns, double value)
{
	struct key *key = grown(tr->key, tr->n, &tr->cap, sizeof(*key));

	if (!key)
		return BB_ERR_NOMEM;
	tr->key = key;
	tr->key[tr->n++] = (struct key){ t_ns, value };
	return BB_OK;
}

/* Events come in order of time, so what a running ramp had planned after t is cut off. */
static enum bb_status add_axis(struct sim_pad_script *s, int64_t t_ns, size_t axis, double value, int64_t ramp_ns)
{
	struct track *tr = &s->axis[axis];
	const double from = track_at(tr, t_ns);
	enum bb_status status;

	while (tr->n && tr->key[tr->n - 1].t_ns > t_ns)
		tr->n--;
	status = add_key(tr, t_ns, from);
	if (status == BB_OK)
		status = add_key(tr, t_ns + ramp_ns, value);
	if (t_ns + ramp_ns > s->last_ns)
		s->last_ns = t_ns + ramp_ns;
	return status;
}

static enum bb_status add_change(struct sim_pad_script *s, int64_t t_ns, uint32_t buttons, double battery)
{
	struct change *change = grown(s->change, s->n_changes, &s->cap_changes, sizeof(*change));

	if (!change)
		return BB_ERR_NOMEM;
	s->change = change;
	s->change[s->n_changes++] = (struct change){ t_ns, buttons, battery };
	if (t_ns > s->last_ns)
		s->last_ns = t_ns;
	return BB_OK;
}

static struct change latest(const struct sim_pad_script *s)
{
	return s->n_changes ? s->change[s->n_changes - 1] : (struct change){ INT64_MIN, 0, (double)NAN };
}

void sim_pad_script_at(const struct sim_pad_script *s, int64_t t_ns, struct sim_pad_state *out)
{
	size_t lo = 0, hi = s->n_changes;

	for (size_t i = 0; i < BB_PAD_AXES; i++)
		out->axis[i] = track_at(&s->axis[i], t_ns);
	while (lo < hi) {
		const size_t mid = (lo + hi) / 2;
		if (s->change[mid].t_ns <= t_ns)
			lo = mid + 1;
		else
			hi = mid;
	}
	out->buttons = lo ? s->change[lo - 1].buttons : 0;
	out->battery = lo ? s->change[lo - 1].battery : (double)NAN;
}

int64_t sim_pad_script_end_ns(const struct sim_pad_script *s)
{
	return s->last_ns;
}

/* Parsing. ----------------------------------------------------------------------------------------------------- */

struct parser {
	struct sim_pad_script *s;
	struct bb_where where;
	struct bb_error *err;
	size_t n_words;
	char *word[WORDS_MAX + 1];
	int64_t t_ns;
};

static enum bb_status number(struct parser *p, size_t i, double least, double most, const char *what, double *out)
{
	const char *text = p->word[i];
	char *end;

	/* strtod would also take "nan", "inf" and hexadecimal floats. */
	if (!*text || text[strspn(text, "0123456789.+-eE")])
		return bb_fail(p->err, BB_ERR_CONFIG, 1331, &p->where, "'%.40s' is no %s", text, what);
	*out = strtod(text, &end);
	if (*end)
		return bb_fail(p->err, BB_ERR_CONFIG, 1331, &p->where, "'%.40s' is no %s", text, what);
	if (!(*out >= least && *out <= most))
		return bb_fail(p->err, BB_ERR_CONFIG, 1332, &p->where, "%s %.40s is not in %g..%g", what, text, least,
		               most);
	return BB_OK;
}

static enum bb_status whole(struct parser *p, size_t i, double least, double most, const char *what, size_t *out)
{
	double value = 0;
	const enum bb_status status = number(p, i, least, most, what, &value);

	if (status != BB_OK)
		return status;
	if (value < floor(value) || value > floor(value))
		return bb_fail(p->err, BB_ERR_CONFIG, 1331, &p->where, "%s %.40s is not whole", what, p->word[i]);
	*out = (size_t)value;
	return BB_OK;
}

static enum bb_status need_words(struct parser *p, size_t n, const char *shape)
{
	if (p->n_words == n)
		return BB_OK;
	return bb_fail(p->err, BB_ERR_CONFIG, 1331, &p->where, "want \"%s\"", shape);
}

static enum bb_status parse_axis(struct parser *p)
{
	size_t axis = 0;
	double value = 0, ramp_s = 0;
	enum bb_status status = need_words(p, 5, "t_s axis N VALUE RAMP_S");

	if (status == BB_OK)
		status = whole(p, 2, 1, BB_PAD_AXES, "axis", &axis);
	if (status == BB_OK)
		status = number(p, 3, -1, 1, "axis value", &value);
	if (status == BB_OK)
		status = number(p, 4, 0, RAMP_MAX_S, "ramp", &ramp_s);
	return status == BB_OK ? add_axis(p->s, p->t_ns, axis - 1, value, llround(ramp_s * 1e9)) : status;
}

static enum bb_status parse_button(struct parser *p)
{
	const struct change now = latest(p->s);
	size_t button = 0;
	enum bb_status status = need_words(p, 4, "t_s button N down|up");

	if (status == BB_OK)
		status = whole(p, 2, 1, 32, "button", &button);
	if (status != BB_OK)
		return status;
	const uint32_t bit = UINT32_C(1) << (button - 1);
	if (!strcmp(p->word[3], "down"))
		return add_change(p->s, p->t_ns, now.buttons | bit, now.battery);
	if (!strcmp(p->word[3], "up"))
		return add_change(p->s, p->t_ns, now.buttons & ~bit, now.battery);
	return bb_fail(p->err, BB_ERR_CONFIG, 1331, &p->where, "'%.40s' is neither down nor up", p->word[3]);
}

static enum bb_status parse_battery(struct parser *p)
{
	double level = 0;
	enum bb_status status = need_words(p, 3, "t_s battery LEVEL");

	if (status == BB_OK)
		status = number(p, 2, 0, 1, "battery level", &level);
	return status == BB_OK ? add_change(p->s, p->t_ns, latest(p->s).buttons, level) : status;
}

static enum bb_status parse_report(struct parser *p)
{
	enum bb_status status = need_words(p, 3 + BB_PAD_AXES, "t_s report A1 A2 A3 A4 A5 A6 BITS");
	double value = 0;
	char *end;

	for (size_t i = 0; i < BB_PAD_AXES && status == BB_OK; i++) {
		status = number(p, 2 + i, -1, 1, "axis value", &value);
		if (status == BB_OK)
			status = add_axis(p->s, p->t_ns, i, value, 0);
	}
	if (status != BB_OK)
		return status;
	const char *text = p->word[2 + BB_PAD_AXES];
	errno = 0;
	const unsigned long bits = strtoul(text, &end, text[0] == '0' && text[1] == 'x' ? 16 : 10);
	if (!isdigit((unsigned char)*text) || *end || errno || bits > UINT32_MAX)
		return bb_fail(p->err, BB_ERR_CONFIG, 1331, &p->where, "'%.40s' are no button bits", text);
	return add_change(p->s, p->t_ns, (uint32_t)bits, latest(p->s).battery);
}

static enum bb_status parse_event(struct parser *p)
{
	static const struct {
		const char *name;
		enum bb_status (*parse)(struct parser *p);
	} kinds[] = {
		{ "axis", parse_axis },
		{ "button", parse_button },
		{ "battery", parse_battery },
		{ "report", parse_report },
	};
	double t_s = 0;
	const enum bb_status status = number(p, 0, 0, T_MAX_S, "time", &t_s);

	if (status != BB_OK)
		return status;
	if (++p->s->n_events > EVENTS_MAX)
		return bb_fail(p->err, BB_ERR_CONFIG, 1334, &p->where, "more than %d events", EVENTS_MAX);
	const int64_t t_ns = llround(t_s * 1e9);
	if (t_ns < p->t_ns)
		return bb_fail(p->err, BB_ERR_CONFIG, 1333, &p->where, "%.40s s is before the line above", p->word[0]);
	p->t_ns = t_ns;
	for (size_t i = 0; p->n_words > 1 && i < BB_ARRAY_LEN(kinds); i++)
		if (!strcmp(p->word[1], kinds[i].name))
			return kinds[i].parse(p);
	return bb_fail(p->err, BB_ERR_CONFIG, 1331, &p->where, "'%.40s' is none of axis, button, battery, report",
	               p->n_words > 1 ? p->word[1] : "");
}

/* Cuts a line into words in place; a comment ends it. */
static void cut(struct parser *p, char *line)
{
	char *save = NULL;

	p->n_words = 0;
	line[strcspn(line, "#")] = '\0';
	for (char *w = strtok_r(line, " \t\r", &save); w && p->n_words <= WORDS_MAX; w = strtok_r(NULL, " \t\r", &save))
		p->word[p->n_words++] = w;
}

static enum bb_status parse_lines(struct parser *p, char *text)
{
	enum bb_status status = BB_OK;

	for (char *line = text; line && status == BB_OK;) {
		char *next = strchr(line, '\n');
		if (next)
			*next++ = '\0';
		p->where.line++;
		cut(p, line);
		if (p->n_words)
			status = parse_event(p);
		line = next;
	}
	return status;
}

enum bb_status sim_pad_script_parse(const char *bytes, size_t n, const char *name, struct sim_pad_script **out,
                                    struct bb_error *err)
{
	struct parser p = { .where = { .file = name }, .err = err };

	*out = NULL;
	if (n > BYTES_MAX)
		return bb_fail(err, BB_ERR_CONFIG, 1334, &p.where, "more than %zu bytes", BYTES_MAX);
	if (memchr(bytes, '\0', n))
		return bb_fail(err, BB_ERR_CONFIG, 1331, &p.where, "a zero byte: this is no text");
	char *text = malloc(n + 1);
	p.s = calloc(1, sizeof(*p.s));
	if (!text || !p.s) {
		free(text);
		free(p.s);
		return bb_fail(err, BB_ERR_NOMEM, 1702, &p.where, "for %zu bytes of events", n);
	}
	memcpy(text, bytes, n);
	text[n] = '\0';
	const enum bb_status status = parse_lines(&p, text);
	free(text);
	if (status != BB_OK) {
		sim_pad_script_free(p.s);
		return status == BB_ERR_NOMEM ? bb_fail(err, status, 1702, &p.where, "for events") : status;
	}
	*out = p.s;
	return BB_OK;
}

enum bb_status sim_pad_script_load(const char *path, struct sim_pad_script **out, struct bb_error *err)
{
	const struct bb_where where = { .file = path };
	FILE *f = fopen(path, "rb");
	size_t n;

	*out = NULL;
	if (!f)
		return bb_fail(err, BB_ERR_CONFIG, 1001, &where, "%s", strerror(errno));
	char *bytes = malloc(BYTES_MAX + 1);
	if (!bytes) {
		fclose(f);
		return bb_fail(err, BB_ERR_NOMEM, 1702, &where, "for a script");
	}
	n = fread(bytes, 1, BYTES_MAX + 1, f);
	enum bb_status status = BB_OK;
	if (ferror(f))
		status = bb_fail(err, BB_ERR_CONFIG, 1002, &where, "reading failed");
	fclose(f);
	if (status == BB_OK)
		status = sim_pad_script_parse(bytes, n, path, out, err);
	free(bytes);
	return status;
}

/* Generating. -------------------------------------------------------------------------------------------------- */

static double between(struct sim_rng *rng, double lo, double hi)
{
	return lo + (hi - lo) * sim_rng_uniform(rng);
}

static enum bb_status move(struct sim_pad_script *s, double t_s, size_t axis, double value, double ramp_s)
{
	return add_axis(s, llround(t_s * 1e9), axis, value, llround(ramp_s * 1e9));
}

static double deflection(struct sim_rng *rng)
{
	const double size = between(rng, 0.3, 1.0);

	return sim_rng_u64(rng) & 1 ? size : -size;
}

/* Two axes leave neutral together, change once without crossing it, and return. */
static enum bb_status sweep(struct sim_pad_script *s, struct sim_rng *rng, double t_s, double for_s)
{
	const size_t first = 2 * (sim_rng_u64(rng) % 2); /* left or right stick; translations or more */
	enum bb_status status = BB_OK;

	for (size_t axis = first; axis < first + 2 && status == BB_OK; axis++) {
		const double value = deflection(rng);
		status = move(s, t_s, axis, value, 0.2);
		if (status == BB_OK)
			status = move(s, t_s + for_s / 2, axis, copysign(between(rng, 0.3, 1.0), value), 0.3);
	}
	for (size_t axis = first; axis < first + 2 && status == BB_OK; axis++)
		status = move(s, t_s + for_s, axis, 0, 0.2);
	return status;
}

static enum bb_status press(struct sim_pad_script *s, struct sim_rng *rng, double t_s)
{
	const uint32_t bit = UINT32_C(1) << (sim_rng_u64(rng) % 2);
	enum bb_status status = add_change(s, llround(t_s * 1e9), bit, (double)NAN);

	return status == BB_OK ? add_change(s, llround((t_s + 0.15) * 1e9), 0, (double)NAN) : status;
}

enum bb_status sim_pad_script_generate(uint64_t seed, const char *id, struct sim_pad_script **out)
{
	struct sim_pad_script *s = calloc(1, sizeof(*s));
	struct sim_rng rng;
	/* The first sweep covers 2.0 to 6.0 s on every pad: a fault planted there always meets a deflected one. */
	double t_s = 1.8, for_s = 4.4;
	enum bb_status status = s ? BB_OK : BB_ERR_NOMEM;

	*out = NULL;
	sim_rng_seed(&rng, seed, "gamepad script", id);
	while (status == BB_OK && t_s + for_s < GENERATED_S) {
		status = sweep(s, &rng, t_s, for_s);
		t_s += for_s + 0.3;
		if (status == BB_OK)
			status = press(s, &rng, t_s);
		t_s += between(&rng, 1.0, 1.7);
		for_s = between(&rng, 1.5, 4.5);
	}
	if (status != BB_OK) {
		sim_pad_script_free(s);
		return status;
	}
	*out = s;
	return BB_OK;
}
