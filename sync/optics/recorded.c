#include "sync/optics/recorded.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define MAGIC "# blackburst optics 1"
#define MOST_S 1e6    /* later than that a double has lost its nanoseconds */
#define MOST_VOLTS 1e6

void bb_recorded_begin(struct bb_recorded *r, const char *path,
                       void (*sample)(void *ctx, const struct bb_recording *r, int64_t at_ns, const double *volts),
                       void *ctx)
{
	memset(r, 0, sizeof(*r));
	r->path = path;
	r->sample = sample;
	r->ctx = ctx;
}

static struct bb_where here(const struct bb_recorded *r)
{
	return (struct bb_where){ r->path, r->line_no, 0 };
}

#define REFUSE(r, err, number, ...)                                                                                  \
	do {                                                                                                         \
		const struct bb_where w_ = here(r);                                                                  \
		return bb_fail(err, BB_ERR_FORMAT, number, &w_, __VA_ARGS__);                                        \
	} while (0)

/* ---- numbers ---- */

/* A plain decimal number at *at; moves past it. strtod alone would take "nan", "inf" and hexadecimal ones. */
static bool take_number(char **at, double *out)
{
	const size_t n = strspn(*at, "+-.0123456789eE");
	char *end;

	if (!n)
		return false;
	errno = 0;
	*out = strtod(*at, &end);
	if (end == *at || (size_t)(end - *at) > n || !isfinite(*out))
		return false;
	*at = end;
	return true;
}

static bool number_alone(char *text, double least, double most, double *out)
{
	return take_number(&text, out) && !*text && *out >= least && *out <= most;
}

/* ---- the head ---- */

static enum bb_status read_show(struct bb_recorded *r, char *value, struct bb_error *err)
{
	struct bb_recording *rec = &r->recording;
	char *save = NULL, *word = strtok_r(value, " ", &save), *from = strtok_r(NULL, " ", &save),
	     *to = strtok_r(NULL, " ", &save);
	enum bb_pattern pattern;
	double a, b;

	if (rec->n_shows == BB_SHOWS_MAX)
		REFUSE(r, err, 1631, "more than %d shows", BB_SHOWS_MAX);
	if (!word || !from || !to || strtok_r(NULL, " ", &save) || !bb_pattern_find(word, &pattern) ||
	    !number_alone(from, -MOST_S, MOST_S, &a) || !number_alone(to, -MOST_S, MOST_S, &b))
		REFUSE(r, err, 1631, "a show is a pattern and two times");
	const struct bb_showing show = { pattern, llround(a * 1e9), llround(b * 1e9) };
	if (show.to_ns <= show.from_ns || (rec->n_shows && show.from_ns < rec->show[rec->n_shows - 1].to_ns))
		REFUSE(r, err, 1631, "shows ascend and lie apart");
	rec->show[rec->n_shows++] = show;
	return BB_OK;
}

/* To a fraction that a phase can be reckoned with: 119.982 is 119982/1000. */
static struct bb_rate rate_of(double hz)
{
	return (struct bb_rate){ (uint32_t)llround(hz * 1e6), 1000000 };
}

static enum bb_status read_key(struct bb_recorded *r, char *key, char *value, struct bb_error *err)
{
	struct bb_recording *rec = &r->recording;
	bool good = true;

	if (!strcmp(key, "show"))
		return read_show(r, value, err);
	if (!strcmp(key, "rate_hz"))
		good = number_alone(value, 10, 2000, &r->rate_hz);
	else if (!strcmp(key, "bandwidth_hz"))
		good = number_alone(value, 0, 1e9, &rec->bandwidth_hz);
	else if (!strcmp(key, "aperture_us"))
		good = number_alone(value, 0, 20000, &rec->aperture_us);
	else if (!strcmp(key, "fps_hz"))
		good = number_alone(value, 1, 1e6, &rec->fps_hz);
	else if (!strcmp(key, "first_s"))
		good = number_alone(value, -MOST_S, MOST_S, &rec->first_s);
	else
		REFUSE(r, err, 1631, "no key '%.40s'", key);
	if (!good)
		REFUSE(r, err, 1631, "%s: '%.40s' is no number in its range", key, value);
	if (r->rate_hz > 0)
		rec->rate = rate_of(r->rate_hz);
	return BB_OK;
}

static enum bb_status read_comment(struct bb_recorded *r, char *line, struct bb_error *err)
{
	char *key = line + 1 + strspn(line + 1, " "), *colon = strchr(key, ':');

	if (r->line_no == 1 && !strcmp(line, MAGIC))
		return BB_OK;
	if (r->headed || key[strcspn(key, " :")] != ':') /* words for people: no key has a blank */
		return BB_OK;
	*colon = '\0';
	return read_key(r, key, colon + 1 + strspn(colon + 1, " "), err);
}

/* "t_s" and then channels in volts: "front.top.left_v". */
static enum bb_status read_columns(struct bb_recorded *r, char *line, struct bb_error *err)
{
	struct bb_recording *rec = &r->recording;
	char *save = NULL, *word = strtok_r(line, ",", &save);

	if (!word || strcmp(word, "t_s"))
		REFUSE(r, err, 1632, "the first column is t_s, time in seconds");
	while ((word = strtok_r(NULL, ",", &save))) {
		const size_t n = strlen(word);
		if (rec->n_channels == BB_CHANNELS_MAX)
			REFUSE(r, err, 1632, "more than %d channels", BB_CHANNELS_MAX);
		if (n < 2 || strcmp(word + n - 2, "_v"))
			REFUSE(r, err, 1632, "'%.60s' does not end in _v, volts", word);
		word[n - 2] = '\0';
		if (!bb_channel_find(word, &rec->channel[rec->n_channels]))
			REFUSE(r, err, 1632, "'%.60s' is no channel: WALL.top.left, WALL.tag.bare, lamp.right", word);
		for (size_t i = 0; i < rec->n_channels; i++)
			if (!memcmp(&rec->channel[i], &rec->channel[rec->n_channels], sizeof(rec->channel[0])))
				REFUSE(r, err, 1632, "'%.60s' stands there twice", word);
		rec->n_channels++;
	}
	if (!rec->n_channels)
		REFUSE(r, err, 1632, "there is no channel");
	if (!rec->n_shows || !(r->rate_hz > 0))
		REFUSE(r, err, 1633, "%s", rec->n_shows ? "rate_hz is missing" : "no show says which pattern was when");
	r->headed = true;
	return BB_OK;
}

/* ---- samples ---- */

static enum bb_status read_sample(struct bb_recorded *r, char *line, struct bb_error *err)
{
	const size_t n_channels = r->recording.n_channels;
	double t_s;

	if (!take_number(&line, &t_s) || !(fabs(t_s) <= MOST_S))
		REFUSE(r, err, 1634, "the time is no finite number of seconds");
	const int64_t at_ns = llround(t_s * 1e9);
	if (r->n_samples && at_ns <= r->last_ns)
		REFUSE(r, err, 1635, "%.9f s does not come after %.9f s", t_s, (double)r->last_ns * 1e-9);
	for (size_t i = 0; i < n_channels; i++) {
		if (*line != ',')
			REFUSE(r, err, 1636, "%zu of %zu voltages", i, n_channels);
		line++;
		if (!take_number(&line, &r->volts[i]) || !(fabs(r->volts[i]) <= MOST_VOLTS))
			REFUSE(r, err, 1634, "column %zu is no finite voltage", i + 2);
	}
	if (*line)
		REFUSE(r, err, 1636, "more than %zu voltages", n_channels);
	r->last_ns = at_ns;
	r->n_samples++;
	if (r->sample)
		r->sample(r->ctx, &r->recording, at_ns, r->volts);
	return BB_OK;
}

/* ---- lines ---- */

static enum bb_status read_line(struct bb_recorded *r, struct bb_error *err)
{
	char *line = r->line;

	if (r->n_line && line[r->n_line - 1] == '\r')
		r->n_line--;
	line[r->n_line] = '\0';
	r->line_no++;
	if (strlen(line) != r->n_line)
		REFUSE(r, err, 1630, "a NUL byte");
	if (r->line_no == 1 && strcmp(line, MAGIC))
		REFUSE(r, err, 1630, "the first line is not '%s'", MAGIC);
	if (!*line)
		return BB_OK;
	if (*line == '#')
		return read_comment(r, line, err);
	return r->headed ? read_sample(r, line, err) : read_columns(r, line, err);
}

enum bb_status bb_recorded_push(struct bb_recorded *r, const char *bytes, size_t n, struct bb_error *err)
{
	while (n) {
		const char *end = memchr(bytes, '\n', n);
		const size_t piece = end ? (size_t)(end - bytes) : n;
		if (piece >= sizeof(r->line) - r->n_line) {
			r->line_no++;
			REFUSE(r, err, 1630, "a line of more than %zu bytes", sizeof(r->line) - 1);
		}
		memcpy(r->line + r->n_line, bytes, piece);
		r->n_line += piece;
		if (!end)
			return BB_OK;
		const enum bb_status status = read_line(r, err);
		r->n_line = 0;
		if (status != BB_OK)
			return status;
		bytes = end + 1;
		n -= piece + 1;
	}
	return BB_OK;
}

/* A last line without its end was cut: half a number is another number. */
enum bb_status bb_recorded_end(struct bb_recorded *r, struct bb_error *err)
{
	if (r->n_line) {
		r->line_no++;
		REFUSE(r, err, 1637, "the last line does not end");
	}
	if (!r->line_no)
		REFUSE(r, err, 1630, "the file is empty");
	if (!r->headed)
		REFUSE(r, err, 1637, "there are no columns");
	return BB_OK;
}
