#include "sim/optics/light.h"

#include <math.h>
#include <string.h>

#define LN9 2.1972245773362196 /* 10-90 % time of an exponential over its tau */
#define SETTLED 1e-9
#define BLACK 1e-3             /* of a display's white: what it cannot help */

/* ---- one first-order follower ---- */

static void tell(struct sim_drives *d, int64_t at_ns, double target)
{
	if (d->n == SIM_LIGHT_AHEAD)
		return;
	unsigned i = d->n++;
	for (; i && d->wait[i - 1].at_ns > at_ns; i--)
		d->wait[i] = d->wait[i - 1];
	d->wait[i] = (struct sim_drive){ at_ns, target };
}

static double follow(double *x, double target, double tau_ns, double dt_ns)
{
	const double from = *x;

	if (!(tau_ns > 0) || fabs(from - target) < SETTLED) {
		*x = target;
		return target;
	}
	*x = target + (from - target) * exp(-dt_ns / tau_ns);
	return target + (from - *x) * tau_ns / dt_ns; /* its mean on the way: the integral of an exponential */
}

/* Steps through the drives that fall into the interval; the mean of x over it. */
static double follow_drives(struct sim_drives *d, double *x, double *target, double up_ns, double down_ns,
                            int64_t from_ns, int64_t to_ns)
{
	double sum = 0;
	int64_t at_ns = from_ns;

	if (!d->n || d->wait[0].at_ns >= to_ns) /* nearly always */
		return follow(x, *target, *target > *x ? up_ns : down_ns, (double)(to_ns - from_ns));
	while (at_ns < to_ns) {
		while (d->n && d->wait[0].at_ns <= at_ns) {
			*target = d->wait[0].target;
			memmove(&d->wait[0], &d->wait[1], --d->n * sizeof(d->wait[0]));
		}
		const int64_t until_ns = d->n && d->wait[0].at_ns < to_ns ? d->wait[0].at_ns : to_ns;
		const double dt_ns = (double)(until_ns - at_ns);
		sum += dt_ns * follow(x, *target, *target > *x ? up_ns : down_ns, dt_ns);
		at_ns = until_ns;
	}
	return sum / (double)(to_ns - from_ns);
}

/* ---- cells ---- */

void sim_cell_init(struct sim_cell *cell, const struct bb_cell *c)
{
	*cell = (struct sim_cell){ .x = 1, .target = 1, .open_tau_ns = c->open_us * 1e3 / LN9,
		                   .close_tau_ns = c->close_us * 1e3 / LN9, .leak = 1 / fmax(c->contrast, 1),
		                   .transmission = c->transmission_percent / 100 };
}

void sim_cell_drive(struct sim_cell *cell, int64_t at_ns, bool open)
{
	tell(&cell->drives, at_ns, open);
}

double sim_cell_step(struct sim_cell *cell, int64_t from_ns, int64_t to_ns)
{
	const double x = follow_drives(&cell->drives, &cell->x, &cell->target, cell->open_tau_ns, cell->close_tau_ns,
	                               from_ns, to_ns);

	return cell->transmission * (cell->leak + (1 - cell->leak) * x);
}

/* ---- patches ---- */

void sim_patch_init(struct sim_patch *p, const struct bb_display_config *d, double height, double spread)
{
	memset(p, 0, sizeof(*p));
	p->display = d;
	p->rise_tau_ns = d->pixel_rise_us * 1e3 / LN9;
	p->fall_tau_ns = d->pixel_fall_us * 1e3 / LN9;
	p->n_rows = d->scan == BB_SCAN_GLOBAL ? 1 : SIM_ROWS;
	/* A spot at the display's edge lies wholly on the display. */
	const double middle = fmin(fmax(height, spread / 2), 1 - spread / 2);
	for (unsigned i = 0; i < p->n_rows; i++) {
		const double place = middle + spread * ((i + 0.5) / p->n_rows - 0.5);
		p->row[i].place = d->scan == BB_SCAN_GLOBAL ? 0 : d->scan == BB_SCAN_UP ? 1 - place : place;
	}
}

void sim_patch_vblank(struct sim_patch *p, int64_t vblank_ns)
{
	if (p->n_ahead < SIM_LIGHT_AHEAD)
		p->ahead_ns[p->n_ahead++] = vblank_ns;
}

void sim_patch_frame(struct sim_patch *p, int64_t vblank_ns, double light)
{
	const double vblank = bb_display_vblank_us(p->display) * 1e3;
	const double active = (double)bb_rate_period_ns(p->display->rate) - vblank;

	sim_patch_vblank(p, vblank_ns);
	for (unsigned i = 0; i < p->n_rows; i++)
		tell(&p->row[i].drives, vblank_ns + llround(vblank + p->row[i].place * active), light);
}

/* Of from..to, how much lies in a stretch that repeats every frame. */
static double overlap(double from, double to, double begin, double length, double period)
{
	double sum = 0;

	for (int k = -1; k <= 1; k++)
		sum += fmax(0, fmin(to, begin + length + k * period) - fmax(from, begin + k * period));
	return sum;
}

/* Share of the interval in which the display's light is on. */
static double lit(const struct sim_patch *p, int64_t from_ns, int64_t to_ns)
{
	const struct bb_display_config *d = p->display;
	const double period = (double)bb_rate_period_ns(d->rate), from = (double)(from_ns - p->vblank_ns),
	             to = (double)(to_ns - p->vblank_ns);

	if (d->kind == BB_DISPLAY_STROBED)
		return fmin(1, overlap(from, to, d->strobe_at_us * 1e3, d->strobe_us * 1e3, period) / (to - from));
	const double dark = d->dark_us * 1e3, picture = bb_display_vblank_us(d) * 1e3;
	return dark > 0 ? 1 - overlap(from, to, picture - dark, dark, period) / (to - from) : 1;
}

double sim_patch_step(struct sim_patch *p, int64_t from_ns, int64_t to_ns)
{
	double x = 0;

	while (p->n_ahead && p->ahead_ns[0] <= from_ns) {
		p->vblank_ns = p->ahead_ns[0];
		memmove(&p->ahead_ns[0], &p->ahead_ns[1], --p->n_ahead * sizeof(p->ahead_ns[0]));
	}
	for (unsigned i = 0; i < p->n_rows; i++)
		x += follow_drives(&p->row[i].drives, &p->row[i].x, &p->row[i].target, p->rise_tau_ns, p->fall_tau_ns,
		                   from_ns, to_ns);
	return lit(p, from_ns, to_ns) * (BLACK + (1 - BLACK) * x / p->n_rows);
}
