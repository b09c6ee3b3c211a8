#include "sync/flash_meter.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define FIELD_COS 0.99619469809174555 /* a 10 degree field: 5 degrees round its middle */
#define FIELD_SR 0.006
#define SHARE 0.25
#define RED 0.8
#define RED_APART 0.2
#define VEIL 0.01 /* of white that lies on every colour: black has white's hue, and dark red is no red */
#define SAME 0.002 /* a wall whose light moved by less is not looked at again */

struct track {                  /* one cell by one rule */
	float low, high;        /* since the last change */
	int8_t way;             /* it went down, up; 0: none yet */
	uint8_t n;              /* changes in `when`, newest last written */
	int64_t when[BB_FLASH_MOST];
};

struct hue { /* red rule: where the last change ended */
	float u, v;
	bool red, known;
};

struct cell {
	struct track track[BB_FLASH_RULES];
	struct hue hue;
};

struct face { /* what does not change of a cell */
	struct bb_vec3 towards;
	double sr;
};

struct bb_flash_meter {
	size_t n_walls;
	struct face *face;      /* [wall][cell] */
	struct cell *cell;      /* [wall][eye][cell] */
	struct last {           /* [wall][eye]: what was looked at last */
		const struct bb_flash_grid *grid;
		uint64_t generation;
		double light;
	} *last;
	float delta[BB_FLASH_RULES], dark[BB_FLASH_RULES];
	unsigned worst[BB_FLASH_RULES];
	uint64_t changes;
	struct bb_flash_worst told;
};

const char *bb_flash_rule_text(enum bb_flash_rule rule)
{
	static const char *const text[] = { "general", "red", "BT.1702" };

	return (size_t)rule < BB_ARRAY_LEN(text) ? text[rule] : "?";
}

double bb_solid_angle(struct bb_vec3 a, struct bb_vec3 b, struct bb_vec3 c)
{
	const double la = bb_vec3_norm(a), lb = bb_vec3_norm(b), lc = bb_vec3_norm(c);
	const double over = bb_vec3_dot(a, bb_vec3_cross(b, c));
	const double under = la * lb * lc + bb_vec3_dot(a, b) * lc + bb_vec3_dot(a, c) * lb + bb_vec3_dot(b, c) * la;

	return 2 * fabs(atan2(over, under));
}

double bb_flash_luminance(const float rgb[3])
{
	return 0.2126 * (double)rgb[0] + 0.7152 * (double)rgb[1] + 0.0722 * (double)rgb[2];
}

/* ---- creation ---- */

static void face_of(const struct bb_corners *c, struct bb_vec3 viewer, unsigned i, struct face *out)
{
	const unsigned column = i % BB_FLASH_COLUMNS, row = BB_FLASH_ROWS - 1 - i / BB_FLASH_COLUMNS;
	struct bb_vec3 p[4];

	for (unsigned k = 0; k < 4; k++) {
		const unsigned right = column + k % 2, up = row + k / 2;
		p[k] = bb_vec3_sub(bb_corners_at(c, (double)right / BB_FLASH_COLUMNS, (double)up / BB_FLASH_ROWS), viewer);
	}
	out->sr = bb_solid_angle(p[0], p[1], p[3]) + bb_solid_angle(p[0], p[3], p[2]);
	out->towards = bb_vec3_unit(bb_vec3_lerp(p[0], p[3], 0.5), (struct bb_vec3){ 0, 0, -1 });
}

enum bb_status bb_flash_create(const struct bb_corners *walls, size_t n_walls, struct bb_vec3 viewer,
                               const struct bb_safety *limits, struct bb_flash_meter **out)
{
	struct bb_flash_meter *m = calloc(1, sizeof(*m));

	*out = NULL;
	if (!m)
		return BB_ERR_NOMEM;
	m->n_walls = n_walls;
	m->face = calloc(n_walls * BB_FLASH_CELLS + 1, sizeof(*m->face));
	m->cell = calloc(n_walls * 2 * BB_FLASH_CELLS + 1, sizeof(*m->cell));
	m->last = calloc(n_walls * 2 + 1, sizeof(*m->last));
	if (!m->face || !m->cell || !m->last) {
		bb_flash_destroy(m);
		return BB_ERR_NOMEM;
	}
	for (size_t w = 0; w < n_walls; w++)
		for (unsigned i = 0; i < BB_FLASH_CELLS; i++)
			face_of(&walls[w], viewer, i, &m->face[w * BB_FLASH_CELLS + i]);
	m->delta[BB_FLASH_GENERAL] = 0.10f;
	m->dark[BB_FLASH_GENERAL] = 0.80f;
	m->delta[BB_FLASH_BT1702] = (float)(20 / limits->white_cd_m2);
	m->dark[BB_FLASH_BT1702] = (float)(160 / limits->white_cd_m2);
	*out = m;
	return BB_OK;
}

void bb_flash_destroy(struct bb_flash_meter *m)
{
	if (!m)
		return;
	free(m->face);
	free(m->cell);
	free(m->last);
	free(m);
}

/* ---- changes of a cell ---- */

/* Turning points, the small ones between them left out: did the value come `delta` away from the last one? */
static bool turned(struct track *t, float y, float delta, float dark)
{
	const float enough = delta - 1e-6f;
	const bool up = y - t->low >= enough && t->low < dark && t->way <= 0;
	const bool down = t->high - y >= enough && y < dark && t->way >= 0;

	if (up || down) {
		t->way = up ? 1 : -1;
		t->low = t->high = y;
		return true;
	}
	t->low = y < t->low ? y : t->low;
	t->high = y > t->high ? y : t->high;
	return false;
}

static struct hue hue_of(const float rgb[3], float light)
{
	const float r = rgb[0] * light + (float)VEIL, g = rgb[1] * light + (float)VEIL, b = rgb[2] * light + (float)VEIL;
	const float x = 0.4124f * r + 0.3576f * g + 0.1805f * b, y = 0.2126f * r + 0.7152f * g + 0.0722f * b,
		    z = 0.0193f * r + 0.1192f * g + 0.9505f * b, sum = x + 15 * y + 3 * z;

	return (struct hue){ 4 * x / sum, 9 * y / sum, r >= (float)RED * (r + g + b), true };
}

static bool turned_red(struct hue *was, struct hue now)
{
	const float apart = hypotf(now.u - was->u, now.v - was->v);

	if (was->known && (was->red || now.red) && apart > (float)RED_APART) {
		*was = now;
		return true;
	}
	if (!was->known || !was->red)
		*was = now;
	return false;
}

/* Changes of a cell in the second up to now. */
static unsigned recent(const struct track *t, int64_t now_ns)
{
	unsigned n = 0;

	for (unsigned i = 0; i < t->n; i++)
		n += now_ns - t->when[i] < BB_NS_PER_S;
	return n;
}

static unsigned note(struct track *t, int64_t now_ns)
{
	if (t->n == BB_FLASH_MOST)
		memmove(&t->when[0], &t->when[1], sizeof(t->when) - sizeof(t->when[0]));
	else
		t->n++;
	t->when[t->n - 1] = now_ns;
	return recent(t, now_ns);
}

/* ---- area ---- */

static struct cell *cells_of(const struct bb_flash_meter *m, unsigned wall, unsigned eye)
{
	return &m->cell[(wall * 2 + eye) * BB_FLASH_CELLS];
}

static double share_of(const struct bb_flash_meter *m, unsigned wall, unsigned eye, unsigned least, int64_t now_ns)
{
	const struct cell *c = cells_of(m, wall, eye);
	unsigned n = 0;

	for (unsigned i = 0; i < BB_FLASH_CELLS; i++)
		n += recent(&c[i].track[BB_FLASH_BT1702], now_ns) >= least;
	return (double)n / BB_FLASH_CELLS;
}

/* Of the cells that changed so often, what lies in the 10 degree field round this one. */
static double field_sr(const struct bb_flash_meter *m, const struct face *middle, unsigned eye, enum bb_flash_rule rule,
                       unsigned least, int64_t now_ns)
{
	double sr = 0;

	for (unsigned w = 0; w < m->n_walls; w++) {
		const struct cell *c = cells_of(m, w, eye);
		for (unsigned i = 0; i < BB_FLASH_CELLS; i++) {
			const struct face *f = &m->face[w * BB_FLASH_CELLS + i];
			if (f == middle || (bb_vec3_dot(f->towards, middle->towards) >= FIELD_COS &&
			                    recent(&c[i].track[rule], now_ns) >= least))
				sr += f->sr;
		}
	}
	return sr;
}

/* Has this wall cells that changed `least` times, and is that a large enough area? */
static bool large(const struct bb_flash_meter *m, unsigned wall, unsigned eye, enum bb_flash_rule rule, unsigned least,
                  int64_t now_ns, double *area)
{
	const struct cell *c = cells_of(m, wall, eye);

	if (rule == BB_FLASH_BT1702) {
		*area = share_of(m, wall, eye, least, now_ns);
		return *area > SHARE;
	}
	for (unsigned i = 0; i < BB_FLASH_CELLS; i++) {
		if (recent(&c[i].track[rule], now_ns) < least)
			continue;
		*area = field_sr(m, &m->face[wall * BB_FLASH_CELLS + i], eye, rule, least, now_ns);
		if (*area > FIELD_SR)
			return true;
	}
	return false;
}

static void judge(struct bb_flash_meter *m, unsigned wall, unsigned eye, enum bb_flash_rule rule, unsigned most,
                  int64_t now_ns)
{
	double area;

	for (unsigned n = most; n > m->worst[rule]; n--) {
		if (!large(m, wall, eye, rule, n, now_ns, &area))
			continue;
		m->worst[rule] = n;
		if (n > 2 * m->told.flashes)
			m->told = (struct bb_flash_worst){ n / 2.0, now_ns, wall, eye, rule, area };
		return;
	}
}

/* ---- frames ---- */

static bool begin_cell(struct cell *c, float y, struct hue hue)
{
	if (c->hue.known)
		return false;
	for (int r = 0; r < BB_FLASH_RULES; r++)
		c->track[r].low = c->track[r].high = y;
	c->hue = hue;
	return true;
}

void bb_flash_frame(struct bb_flash_meter *m, unsigned wall, unsigned eye, int64_t at_ns, const struct bb_flash_grid *g,
                    double light)
{
	struct cell *cells = cells_of(m, wall, eye);
	unsigned most[BB_FLASH_RULES] = { 0 };

	struct last *last = &m->last[wall * 2 + eye];
	if (last->grid == g && last->generation == g->generation && fabs(last->light - light) < SAME)
		return;
	*last = (struct last){ g, g->generation, light };
	for (unsigned i = 0; i < BB_FLASH_CELLS; i++) {
		struct cell *c = &cells[i];
		const float y = (float)(bb_flash_luminance(g->rgb[i]) * light);
		const struct hue hue = hue_of(g->rgb[i], (float)light);

		if (begin_cell(c, y, hue))
			continue;
		for (int r = 0; r < BB_FLASH_RULES; r++) {
			if (r == BB_FLASH_RED ? !turned_red(&c->hue, hue) : !turned(&c->track[r], y, m->delta[r], m->dark[r]))
				continue;
			const unsigned n = note(&c->track[r], at_ns);
			most[r] = n > most[r] ? n : most[r];
			m->changes++;
		}
	}
	for (int r = 0; r < BB_FLASH_RULES; r++)
		judge(m, wall, eye, (enum bb_flash_rule)r, most[r], at_ns);
}

struct bb_flash_worst bb_flash_worst(const struct bb_flash_meter *m)
{
	return m->told;
}

uint64_t bb_flash_changes(const struct bb_flash_meter *m)
{
	return m->changes;
}

double bb_flash_cell_sr(const struct bb_flash_meter *m, unsigned wall, unsigned cell)
{
	return m->face[wall * BB_FLASH_CELLS + cell].sr;
}
