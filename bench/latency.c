#include "bench/latency.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bench/file.h"
#include "bench/result.h"

static const struct {
	const char *name, *owner, *help;
	int modelled;
} links[BB_LINK_COUNT] = {
#define X(id, name, owner, modelled, help) [id] = { name, owner, help, modelled },
	BB_LINK_LIST(X)
#undef X
};

const char *bb_latency_name(enum bb_link_id link)
{
	return links[link].name;
}

static bool whole(const struct bb_frame_row *row)
{
	return isfinite(row->head_to_photon_ms) && row->chained;
}

static struct bb_summary summed(const struct bb_frame_row *row, size_t n, int link, double *scratch)
{
	struct bb_tally t = { 0 };
	size_t at = 0;

	for (size_t i = 0; i < n; i++) {
		if (!whole(&row[i]))
			continue;
		const double ms = link == BB_LINK_COUNT ? row[i].head_to_photon_ms : row[i].link_ns[link] * 1e-6;
		bb_tally_add(&t, ms);
		scratch[at++] = ms;
	}
	return bb_stats_summary(&t, scratch, at);
}

/* Of stamps: a camera's on the exposure's ends, a display's on the flip, the phase of the shutters. */
static double uncertainty_ms(const struct bb_run_result *r, enum bb_link_id link, bool modelled)
{
	switch (link) {
	case BB_LINK_EXPOSURE:
	case BB_LINK_READOUT:
		return 0; /* settings of the camera */
	case BB_LINK_TRANSFER:
		return r->stamp_error_ms[0];
	case BB_LINK_PRESENT:
	case BB_LINK_SCANOUT:
		return r->stamp_error_ms[1];
	case BB_LINK_SHUTTER:
		return hypot(r->stamp_error_ms[1], r->stamp_error_ms[2]);
	default:
		return modelled ? BB_UNKNOWN : 0; /* one clock reads both ends */
	}
}

static double rms(double sum, size_t n)
{
	return n ? sqrt(sum / (double)n) : BB_UNKNOWN;
}

static struct bb_prediction prediction_of(const struct bb_frame_row *row, size_t n)
{
	struct bb_prediction p = { 0 };

	for (size_t i = 0; i < n; i++) {
		if (!isfinite(row[i].photon_error_mm + row[i].unpredicted_mm) || row[i].flags & BB_FRAME_POSE_OLD)
			continue;
		p.n++;
		p.with_mm += row[i].photon_error_mm * row[i].photon_error_mm;
		p.without_mm += row[i].unpredicted_mm * row[i].unpredicted_mm;
		p.with_deg += row[i].photon_error_deg * row[i].photon_error_deg;
		p.without_deg += row[i].unpredicted_deg * row[i].unpredicted_deg;
		p.horizon_ms += row[i].horizon_ms;
	}
	p.with_mm = rms(p.with_mm, p.n);
	p.without_mm = rms(p.without_mm, p.n);
	p.with_deg = rms(p.with_deg, p.n);
	p.without_deg = rms(p.without_deg, p.n);
	p.horizon_ms = p.n ? p.horizon_ms / (double)p.n : BB_UNKNOWN;
	return p;
}

/* What the settings and the rate of the devices fix is no place to begin; of the rest the largest share is. */
static bool is_fixed(int link)
{
	return link == BB_LINK_EXPOSURE || link == BB_LINK_READOUT || link == BB_LINK_SCANOUT;
}

static void advise(struct bb_latency *l)
{
	static const char *const how[BB_LINK_COUNT] = {
		[BB_LINK_TRANSFER] = "fewer bytes from the cameras: blobs instead of pictures, or a faster bus",
		[BB_LINK_WAIT] = "let the exposure end just before a frame begins: shift sync_offset_us, or raise rate_hz",
		[BB_LINK_BLOBS] = "blobs by the cameras themselves, or more cores",
		[BB_LINK_POSE] = "fewer cameras or blobs, or a faster head node",
		[BB_LINK_PREDICT] = "a faster head node",
		[BB_LINK_STATE] = "a faster network",
		[BB_LINK_SELECT] = "a smaller brick budget",
		[BB_LINK_RENDER] = "coarser sampling, or a faster node",
		[BB_LINK_BARRIER] = "even the nodes out: the barrier waits for the slowest",
		[BB_LINK_PRESENT] = "begin frames later or read the cameras again before drawing: the image waits for its vblank",
		[BB_LINK_SHUTTER] = "plan the shutters anew (blackburst phase)",
	};
	int most = -1;

	for (int i = 0; i < BB_LINK_COUNT; i++)
		if (!is_fixed(i) && (most < 0 || l->link[i].summary.mean > l->link[most].summary.mean))
			most = i;
	bb_text_format(l->attack, sizeof(l->attack), "%s first: %.1f of %.1f ms (%.0f %%), owned by the %s; %s.", l->link[most].name,
	               l->link[most].summary.mean, l->total.mean, 100 * l->link[most].summary.mean / l->total.mean,
	               l->link[most].owner, how[most]);
}

bool bb_latency_of(const struct bb_run_result *r, struct bb_latency *out)
{
	const struct bb_frame_row *row;
	const size_t n = bb_ledger_rows(r->ledger, &row);
	double *scratch = malloc((n + 1) * sizeof(*scratch)), sum_sq = 0;
	size_t in_50 = 0, in_20 = 0;

	memset(out, 0, sizeof(*out));
	if (!scratch)
		return false;
	for (int i = 0; i < BB_LINK_COUNT; i++) {
		const bool modelled = links[i].modelled > (strcmp(r->clock, "virtual") ? 1 : 0);
		struct bb_latency_link *k = &out->link[i];
		*k = (struct bb_latency_link){ links[i].name, links[i].owner, links[i].help, modelled,
			                       uncertainty_ms(r, (enum bb_link_id)i, modelled), summed(row, n, i, scratch) };
		out->floor_ms += is_fixed(i) ? k->summary.mean : 0;
	}
	out->total = summed(row, n, BB_LINK_COUNT, scratch);
	free(scratch);
	out->n = out->total.n;
	for (size_t i = 0; i < n; i++) {
		in_50 += whole(&row[i]) && row[i].head_to_photon_ms <= 50;
		in_20 += whole(&row[i]) && row[i].head_to_photon_ms <= 20;
	}
	for (int i = 0; i < 3; i++) /* the two ends, and what the shutter adds: everything between is read on one clock */
		sum_sq += r->stamp_error_ms[i] * r->stamp_error_ms[i];
	out->uncertainty_ms = sqrt(sum_sq);
	out->prediction = prediction_of(row, n);
	if (!out->n)
		return true;
	out->within_50 = (double)in_50 / (double)out->n;
	out->within_20 = (double)in_20 / (double)out->n;
	advise(out);
	return true;
}
