/* sim/sim_display.c: one scan-out; the model stands in sim/sim_display.h. One timer, on the owner's thread. */
#include "sim/sim_display.h"
#include "sim/sim.h"
#include "sim/sim_option.h"

#include <math.h>
#include <string.h>

#define PENDING 2
#define RESULTS 32
#define GENLOCK_OFFSET_NS 5000.0
#define FREE_PPM 20.0
#define STAMP_NS 1000

struct pending {
	uint64_t frame;
	int64_t k;           /* vblank it will flip at */
	uint32_t target_seq;
	uint8_t eye;
};

struct sim_display {
	struct bb_display base;
	struct sim_world *world;
	struct bb_timer timer;
	bool ideal;
	int64_t offset_ns;            /* behind the reference, genlocked */
	int64_t own_ppb;              /* of the crystal */
	int64_t zero_k, zero_ns;      /* free: vblank zero_k begins at zero_ns */
	int64_t past_ns;              /* when the vblank before zero_k began, on the axis there was then */
	int64_t zero_frame;           /* genlocked: vblank k is instant k - zero_k + zero_frame of the reference */
	int64_t unlocked, lost, swallow, late, added_ppb; /* sums over faults */
	struct pending pending[PENDING];
	uint32_t n_pending;
	int64_t last_k;               /* last vblank that flipped or swallowed an image */
	int64_t newest_k, newest_ns, next_ns; /* at known_ns: the newest vblank, and when the one after it begins; */
	int64_t known_ns;
	uint32_t bends;               /* while the reference is bent no more, and the axis stands; next 0: not known */
	struct bb_flip result[RESULTS];
	uint32_t head, n_results;
	uint64_t unread, swallowed;
};

static struct sim_display *own(struct bb_display *d)
{
	return bb_container_of(d, struct sim_display, base);
}

/* Scan-out */

static bool locked(const struct sim_display *s)
{
	return s->base.config.genlock && !s->unlocked;
}

static int64_t vblank_ns(const struct sim_display *s, int64_t k)
{
	const struct bb_rate rate = s->base.config.rate;

	if (k < s->zero_k)
		return s->past_ns;
	if (locked(s))
		return sim_world_reference_ns(s->world, rate, k - s->zero_k + s->zero_frame) + s->offset_ns;
	const int64_t dt_ns = bb_rate_frame_ns(rate, k - s->zero_k);
	return s->zero_ns + dt_ns - (int64_t)((__int128)dt_ns * (s->own_ppb + s->added_ppb) / BB_NS_PER_S);
}

/* The first vblank at or after a time, not before the axis begins. */
static int64_t vblank_after(const struct sim_display *s, int64_t at_ns)
{
	const struct bb_rate rate = s->base.config.rate;

	if (locked(s)) {
		const int64_t k = sim_world_reference_after(s->world, rate, at_ns - s->offset_ns);
		return (k < s->zero_frame ? s->zero_frame : k) - s->zero_frame + s->zero_k;
	}
	const int64_t span_ns = at_ns - s->zero_ns;
	const int64_t ideal_ns =
		span_ns + (int64_t)((__int128)span_ns * (s->own_ppb + s->added_ppb) / BB_NS_PER_S);
	int64_t frames = (int64_t)((__int128)ideal_ns * rate.num / ((__int128)rate.den * BB_NS_PER_S));
	frames -= frames / 100000 + 2; /* the inverse is of first order: start below and walk */
	int64_t k = s->zero_k + (frames > 0 ? frames : 0);
	while (vblank_ns(s, k) < at_ns)
		k++;
	return k;
}

static int64_t stamp(const struct sim_display *s, int64_t at_ns)
{
	return s->ideal ? at_ns : at_ns - at_ns % STAMP_NS;
}

/*
 * Newest vblank at or before now, or zero_k - 1. Asked several times a frame of every display: looked up once, and from
 * the last one when it is the next.
 */
static int64_t newest(struct sim_display *s)
{
	const int64_t now_ns = bb_clock_now_ns(s->base.dev.clk);
	const uint32_t bends = sim_world_reference_bends(s->world);
	const bool known = s->next_ns > 0 && bends == s->bends && now_ns >= s->known_ns;

	if (known && now_ns < s->next_ns)
		return s->newest_k;
	const int64_t after_ns = known ? vblank_ns(s, s->newest_k + 2) : 0;
	if (known && now_ns < after_ns) {
		s->newest_k++;
		s->newest_ns = s->next_ns;
		s->next_ns = after_ns;
	} else {
		s->newest_k = vblank_after(s, now_ns + 1) - 1;
		s->newest_ns = vblank_ns(s, s->newest_k);
		s->next_ns = vblank_ns(s, s->newest_k + 1);
	}
	s->known_ns = now_ns;
	s->bends = bends;
	return s->newest_k;
}

/* Before something changes: scan-out goes on from here with the next number. */
static void hold_axis(struct sim_display *s)
{
	const int64_t k = newest(s), next_ns = vblank_ns(s, k + 1);

	s->past_ns = vblank_ns(s, k);
	s->zero_ns = next_ns;
	s->zero_frame += k + 1 - s->zero_k;
	s->zero_k = k + 1;
	s->next_ns = 0;
}

int64_t sim_display_vblank_ns(const struct bb_display *d, int64_t k)
{
	return vblank_ns((const struct sim_display *)(const void *)d, k); /* base is the first member */
}

/* Flips */

static void keep_result(struct sim_display *s, const struct pending *p, int64_t at_ns)
{
	const struct bb_flip flip = { p->frame, stamp(s, at_ns), (uint32_t)p->k, p->target_seq, p->eye };

	if (s->n_results == RESULTS) {
		s->head = (s->head + 1) % RESULTS;
		s->n_results--;
		s->unread++;
	}
	s->result[(s->head + s->n_results++) % RESULTS] = flip;
	bb_device_event(&s->base.dev, BB_EV_FLIP, at_ns, (int64_t)p->frame, p->k);
}

static int64_t step(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct sim_display *s = bb_container_of(timer, struct sim_display, timer);

	(void)now_ns;
	if (!s->n_pending || s->lost)
		return BB_NEVER;
	const struct pending p = s->pending[0];
	memmove(&s->pending[0], &s->pending[1], --s->n_pending * sizeof(p));
	s->last_k = p.k;
	if (s->swallow) {
		s->swallow--;
		s->swallowed++;
	} else {
		keep_result(s, &p, scheduled_ns);
	}
	return s->n_pending ? vblank_ns(s, s->pending[0].k) : BB_NEVER;
}

/* After the axis moved: what waits for a vblank waits for it at its new time. */
static void rearm(struct sim_display *s)
{
	bb_clock_disarm(s->base.dev.clk, &s->timer);
	if (s->n_pending && !s->lost &&
	    bb_clock_arm(s->base.dev.clk, &s->timer, vblank_ns(s, s->pending[0].k)) != BB_OK)
		s->n_pending = 0;
}

/* Ops */

static const struct sim_option options[] = {
	{ "rate_error_ppm", offsetof(struct bb_display_config, rate_error_ppm), -500, 500 },
	{ NULL, 0, 0, 0 },
};

static enum bb_status check_config(struct sim_display *s)
{
	const struct bb_display_config *c = &s->base.config;

	if (!c->rate.num || !c->rate.den || !(bb_rate_hz(c->rate) >= 10 && bb_rate_hz(c->rate) <= 1000))
		return bb_device_fail(&s->base.dev, BB_ERR_RANGE, "open", "rate %u/%u", c->rate.num, c->rate.den);
	if (!isnan(c->rate_error_ppm) && !(fabs(c->rate_error_ppm) <= 500))
		return bb_device_fail(&s->base.dev, BB_ERR_RANGE, "open", "rate error %g ppm", c->rate_error_ppm);
	if (!(c->vblank_us >= 0 && c->vblank_us * 1000 < (double)bb_rate_period_ns(c->rate)))
		return bb_device_fail(&s->base.dev, BB_ERR_RANGE, "open", "vblank of %g us", c->vblank_us);
	return BB_OK;
}

static void draw_unit(struct sim_display *s, uint64_t seed)
{
	const struct bb_display_config *c = &s->base.config;
	struct sim_rng r;

	if (s->ideal)
		return;
	sim_rng_seed(&r, seed, "display", s->base.dev.id);
	s->offset_ns = (int64_t)(sim_rng_uniform(&r) * GENLOCK_OFFSET_NS);
	s->zero_ns = (int64_t)(sim_rng_uniform(&r) * (double)bb_rate_period_ns(c->rate));
	const double ppm = (2 * sim_rng_uniform(&r) - 1) * FREE_PPM;
	s->own_ppb = llround((isnan(c->rate_error_ppm) ? ppm : c->rate_error_ppm) * 1000);
}

static enum bb_status display_open(struct bb_display *d, const struct bb_open *open)
{
	struct sim_display *s = own(d);

	s->world = open->world;
	s->ideal = open->fidelity == 0;
	enum bb_status status = sim_options_read(&d->dev, open->uri, options, &d->config);
	if (status == BB_OK)
		status = check_config(s);
	if (status != BB_OK)
		return status;
	draw_unit(s, open->seed);
	s->last_k = -1;
	s->timer = (struct bb_timer){ .step = step, .rank = 1 };
	const int64_t period_ns = bb_rate_period_ns(d->config.rate);
	d->limits = (struct bb_display_limits){
		.period_ns = period_ns,
		.vblank_ns = d->config.vblank_us > 0 ? llround(d->config.vblank_us * 1000) : period_ns / 25,
		.stamp_error_ns = s->ideal ? 0 : STAMP_NS,
		.most_queued = PENDING,
	};
	return sim_world_register(s->world, "display", d->dev.id, s, sim_display_verbs);
}

static void display_close(struct bb_display *d)
{
	struct sim_display *s = own(d);

	sim_world_unregister(s->world, s);
	bb_clock_disarm(d->dev.clk, &s->timer);
}

static enum bb_status gone(struct sim_display *s, const char *op)
{
	return bb_device_fail(&s->base.dev, BB_ERR_LOST, op, "the connector is empty");
}

static enum bb_status display_vblank(struct bb_display *d, struct bb_vblank *out)
{
	struct sim_display *s = own(d);

	if (s->lost)
		return gone(s, "vblank");
	const int64_t k = newest(s);
	if (k < 0)
		return BB_TIMEOUT;
	*out = (struct bb_vblank){ stamp(s, s->newest_ns), (uint32_t)k };
	return BB_OK;
}

static enum bb_status display_present(struct bb_display *d, uint64_t frame, enum bb_eye eye, uint32_t target_seq)
{
	struct sim_display *s = own(d);

	if (s->lost)
		return gone(s, "present");
	if (s->n_pending == PENDING)
		return BB_ERR_BUSY;
	int64_t k = newest(s) + 1;
	/* Sequences wrap: a target is later when the difference, as a signed number, is positive. */
	const int32_t ahead = (int32_t)(target_seq - (uint32_t)k);
	if (ahead > 0)
		k += ahead;
	const int64_t before_k = s->n_pending ? s->pending[s->n_pending - 1].k : s->last_k;
	if (k <= before_k)
		k = before_k + 1;
	k += s->late;
	const int64_t at_ns = k == s->newest_k + 1 ? s->next_ns : vblank_ns(s, k);
	if (!s->n_pending && bb_clock_arm(d->dev.clk, &s->timer, at_ns) != BB_OK)
		return BB_ERR_NOMEM;
	s->pending[s->n_pending++] = (struct pending){ frame, k, target_seq, (uint8_t)eye };
	return BB_OK;
}

static enum bb_status display_flips(struct bb_display *d, struct bb_flip *flips, size_t cap, size_t *n_out)
{
	struct sim_display *s = own(d);

	if (s->lost)
		return gone(s, "flips");
	for (; *n_out < cap && s->n_results; s->n_results--) {
		flips[(*n_out)++] = s->result[s->head];
		s->head = (s->head + 1) % RESULTS;
	}
	return *n_out ? BB_OK : BB_TIMEOUT;
}

/* Without its reference a framelock board goes on counting its own vblanks: the group's counters drift apart. */
static enum bb_status display_swap_counter(struct bb_display *d, uint64_t *counter_out)
{
	struct sim_display *s = own(d);

	if (s->lost)
		return gone(s, "swap_counter");
	if (!d->config.genlock)
		return BB_ERR_UNSUPPORTED;
	const int64_t k = newest(s);
	*counter_out = k < 0 ? 0 : (uint64_t)k;
	return BB_OK;
}

static const struct bb_display_ops ops = { display_open,    display_close, display_vblank,
	                                   display_present, display_flips, display_swap_counter };
const struct bb_display_driver sim_display_driver = { "sim", sizeof(struct sim_display), &ops };

uint64_t sim_display_unread(const struct bb_display *d)
{
	return ((const struct sim_display *)(const void *)d)->unread;
}

uint64_t sim_display_swallowed(const struct bb_display *d)
{
	return ((const struct sim_display *)(const void *)d)->swallowed;
}

/* Verbs */

static enum bb_status verb_drop_flip(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_display *s = device;
	double n;
	const enum bb_status status = sim_fault_range(args, "n", 1, 1, 1e6, &n, err);

	if (status == BB_OK && s)
		s->swallow += on ? llround(n) : -llround(n);
	if (s && s->swallow < 0) /* used up before the fault's time was over */
		s->swallow = 0;
	return status;
}

static enum bb_status verb_late(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_display *s = device;
	double frames;
	const enum bb_status status = sim_fault_range(args, "frames", 1, 1, 1000, &frames, err);

	if (status == BB_OK && s)
		s->late += on ? llround(frames) : -llround(frames);
	return status;
}

static enum bb_status verb_rate(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_display *s = device;
	double ppm;
	const enum bb_status status = sim_fault_range(args, "ppm", SIM_FAULT_REQUIRED, -500, 500, &ppm, err);

	if (status != BB_OK || !s)
		return status;
	hold_axis(s); /* a genlocked display follows its reference whatever its crystal does */
	s->added_ppb += llround(on ? ppm * 1000 : ppm * -1000);
	rearm(s);
	return BB_OK;
}

static enum bb_status verb_unlock(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_display *s = device;

	(void)args;
	(void)err;
	if (!s)
		return BB_OK;
	const bool was = locked(s);
	const int64_t now_ns = bb_clock_now_ns(s->base.dev.clk);
	hold_axis(s);
	s->unlocked += on ? 1 : -1;
	if (locked(s) && !was) /* genlock comes back at once, where the reference is by now */
		s->zero_frame = sim_world_reference_after(s->world, s->base.config.rate, now_ns + 1 - s->offset_ns);
	rearm(s);
	return BB_OK;
}

static enum bb_status verb_unplug(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_display *s = device;

	(void)args;
	(void)err;
	if (!s)
		return BB_OK;
	s->lost += on ? 1 : -1;
	s->n_pending = 0;
	s->n_results = 0;
	rearm(s);
	return BB_OK;
}

const struct sim_verb sim_display_verbs[] = {
	{ "drop_flip", "[n=N]", "the next n images are never shown; the old one stays, and no result comes", "n=1",
	  verb_drop_flip },
	{ "late", "[frames=N]", "images appear N refreshes after their target", "frames=1", verb_late },
	{ "rate", "ppm=N", "its crystal runs that much faster; no effect while genlocked", "ppm=100", verb_rate },
	{ "unlock", "", "genlock is lost: it runs on its own crystal", "", verb_unlock },
	{ "unplug", "", "the cable is out: dark, and its node cannot reach it", "", verb_unplug },
	{ NULL, NULL, NULL, NULL, NULL },
};
