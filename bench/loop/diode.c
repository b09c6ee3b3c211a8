#include "bench/loop/diode.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bench/result.h"
#include "bench/stats.h"
#include "sim/optics/sensor.h"
#include "sim/sim_display.h"

#define LOOK_NS (100 * INT64_C(1000000)) /* after the begin of a frame that lights up: longer than any head to photon */
#define FLIPS 8
#define EDGES_MOST 512
#define SAMPLES_MOST 8192 /* 100 ms at 50 kHz, and a frame more */
#define LIT_V 0.1         /* above the noise of the dark */

struct edge { /* the patch lit up with a frame */
	uint64_t frame;
	int64_t lamp_ns, mid_exposure_ns, photon_ns; /* photon_ns 0: the frame is not closed yet */
};
struct bb_diode {
	const struct bb_rig *rig;
	struct sim_optics *optics;
	struct sim_diodes diodes;
	bool sampling, was_bright;
	uint64_t seed;
	uint8_t lens;
	int64_t now_ns, until_ns, next_k;
	size_t n_samples;
	int64_t sample_ns[SAMPLES_MOST];
	double volts[SAMPLES_MOST];
	struct {
		uint32_t seq;
		uint64_t frame;
		enum bb_eye eye;
		bool fresh;
	} flip[FLIPS];
	uint64_t bright;       /* bit frame % 64 */
	struct edge open;      /* being looked for */
	size_t n;
	double end_ms[EDGES_MOST], links_ms[EDGES_MOST], off_ms[EDGES_MOST];
};

static bool is_sim(const char *device)
{
	return !*device || !strncmp(device, "sim:", 4);
}

static bool worth_it(const struct bb_rig *rig, const struct bb_scene *scene)
{
	return scene->patch.follows == BB_FOLLOWS_CAMERAS && scene->patch.hz > 0 && rig->shutter && rig->room->n_screens &&
	       rig->needs[BB_CLASS_SHUTTERS] >= 2 && rig->needs[BB_CLASS_DISPLAYS] >= 2 && rig->needs[BB_CLASS_CAMERAS] >= 0 &&
	       is_sim(rig->room->chain.device) && is_sim(rig->room->screens[0].display.device);
}

enum bb_status bb_diode_create(const struct bb_rig *rig, const struct bb_scene *scene, uint64_t seed, struct bb_diode **out)
{
	const struct sim_look look = sim_look_bands();
	const size_t first = 0;
	struct bb_diode *x;

	*out = NULL;
	if (!worth_it(rig, scene))
		return BB_OK;
	x = calloc(1, sizeof(*x));
	if (!x)
		return BB_ERR_NOMEM;
	const enum bb_status status = sim_optics_create(rig->room, &first, 1, &look, &x->optics);
	if (status != BB_OK) {
		free(x);
		return status;
	}
	sim_optics_show(x->optics, 0, BB_PATTERN_BLACK_BLACK);
	x->rig = rig;
	x->seed = seed;
	/* One projector for both eyes: what the first eye sees. Two behind shutters: their common light on the wall. */
	x->lens = rig->room->screens[0].display.stereo == BB_STEREO_FRAME_SEQUENTIAL ? BB_LENS_LEFT : BB_LENS_BARE;
	*out = x;
	return BB_OK;
}

void bb_diode_destroy(struct bb_diode *x)
{
	if (!x)
		return;
	sim_optics_destroy(x->optics);
	free(x);
}

void bb_diode_edge(struct bb_diode *x, const struct bb_shutter_edge *e)
{
	if (x)
		sim_optics_edge(x->optics, e);
}

void bb_diode_flip(struct bb_diode *x, uint16_t screen, const struct bb_flip *flip)
{
	if (!x || screen)
		return;
	x->flip[flip->seq % FLIPS].seq = flip->seq;
	x->flip[flip->seq % FLIPS].frame = flip->frame;
	x->flip[flip->seq % FLIPS].eye = (enum bb_eye)flip->eye;
	x->flip[flip->seq % FLIPS].fresh = true;
}

static void tell_vblanks(struct bb_diode *x, int64_t now_ns)
{
	const struct bb_display *d = x->rig->displays[0];

	for (int64_t at_ns; (at_ns = sim_display_vblank_ns(d, x->next_k)) <= now_ns; x->next_k++) {
		const size_t slot = (uint32_t)x->next_k % FLIPS;
		if (at_ns < x->now_ns - LOOK_NS)
			continue; /* before the scene */
		if (!x->flip[slot].fresh || x->flip[slot].seq != (uint32_t)x->next_k) {
			sim_optics_vblank(x->optics, 0, at_ns);
			continue;
		}
		const bool bright = x->bright >> x->flip[slot].frame % 64 & 1;
		sim_optics_show(x->optics, 0, bright ? BB_PATTERN_WHITE_WHITE : BB_PATTERN_BLACK_BLACK);
		sim_optics_frame(x->optics, 0, at_ns, x->flip[slot].eye);
		x->flip[slot].fresh = false;
	}
}

static void begin_sampling(struct bb_diode *x, int64_t from_ns)
{
	const struct sim_diode_config usual = sim_diode_default();

	sim_diodes_init(&x->diodes, &usual, x->optics, x->seed + x->open.frame, from_ns);
	x->diodes.n_diodes = 1;
	x->diodes.diode[0].channel.spot = BB_SPOT_MIDDLE;
	x->diodes.diode[0].channel.lens = x->lens;
	x->n_samples = 0;
	x->sampling = true;
}

static void sample(struct bb_diode *x)
{
	double v;
	const int64_t at_ns = sim_diodes_sample(&x->diodes, &v);

	if (x->n_samples == SAMPLES_MOST)
		return;
	x->sample_ns[x->n_samples] = at_ns;
	x->volts[x->n_samples++] = v;
}

/* Where the light is half of what it comes to, between the two samples it lies between; 0: it stayed dark. */
static int64_t lit_ns(const struct bb_diode *x)
{
	const double dark = x->diodes.config.offset_v;
	double white = dark;

	for (size_t i = 0; i < x->n_samples; i++)
		white = fmax(white, x->volts[i]);
	const double half = (dark + white) / 2;
	for (size_t i = 1; i < x->n_samples && white > dark + LIT_V; i++) {
		const double was = x->volts[i - 1], is = x->volts[i];
		if (was < half && is >= half)
			return x->sample_ns[i - 1] + llround((double)(x->sample_ns[i] - x->sample_ns[i - 1]) * (half - was) / (is - was));
	}
	return 0;
}

/* The light is looked for a while longer than it should take: what comes late is seen, and is off. */
static void end_sampling(struct bb_diode *x)
{
	const struct edge *e = &x->open;
	const int64_t light_ns = lit_ns(x);

	x->sampling = false;
	if (!light_ns || !e->photon_ns || x->n == EDGES_MOST)
		return;
	x->end_ms[x->n] = (double)(light_ns - e->lamp_ns) * 1e-6;
	x->links_ms[x->n] = (double)(e->photon_ns - e->mid_exposure_ns) * 1e-6;
	x->off_ms[x->n++] = (double)(light_ns - e->photon_ns) * 1e-6;
}

void bb_diode_frame(struct bb_diode *x, uint64_t frame, bool bright, int64_t now_ns)
{
	if (!x)
		return;
	if (bright)
		x->bright |= UINT64_C(1) << frame % 64;
	else
		x->bright &= ~(UINT64_C(1) << frame % 64);
	tell_vblanks(x, now_ns);
	while (x->sampling && sim_diodes_next_ns(&x->diodes) <= now_ns)
		sample(x);
	if (x->sampling && now_ns >= x->until_ns)
		end_sampling(x);
	if (!x->sampling)
		sim_optics_step(x->optics, now_ns);
	x->now_ns = now_ns;
	if (bright && !x->was_bright && !x->sampling) {
		x->open = (struct edge){ .frame = frame };
		x->until_ns = now_ns + LOOK_NS;
		begin_sampling(x, now_ns);
	}
	x->was_bright = bright;
}

void bb_diode_close(struct bb_diode *x, uint64_t frame, int64_t lamp_ns, int64_t mid_exposure_ns, int64_t photon_ns)
{
	if (!x || !x->sampling || frame != x->open.frame || !mid_exposure_ns)
		return;
	x->open.lamp_ns = lamp_ns;
	x->open.mid_exposure_ns = mid_exposure_ns;
	x->open.photon_ns = photon_ns;
}

void bb_diode_tell(const struct bb_diode *x, struct bb_latency_test *out)
{
	memset(out, 0, sizeof(*out));
	if (!x || !x->n)
		return;
	out->n = x->n;
	for (size_t i = 0; i < x->n; i++) {
		out->end_ms += x->end_ms[i] / (double)x->n;
		out->links_ms += x->links_ms[i] / (double)x->n;
		out->off_ms += x->off_ms[i] / (double)x->n;
		out->most_ms = fmax(out->most_ms, x->end_ms[i]);
	}
	for (size_t i = 0; i < x->n; i++)
		out->scatter_ms = fmax(out->scatter_ms, fabs(x->off_ms[i] - out->off_ms));
}
