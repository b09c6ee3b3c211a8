#include "hal/safety.h"

#include <string.h>

struct bb_safety bb_safety_ceilings(void)
{
	return (struct bb_safety){
		.flashes_per_s = 3,
		.fade_ms = 500,
		.transition_gap_s = 2,
		.shutter_least_hz = 50,
		.holdover_most_s = 900,
		.white_cd_m2 = 200,
		.outlet_least_off_s = 180,
		.outlet_least_on_s = 60,
		.outlet_cycles_per_hour = 4,
		.outlet_stagger_ms = 500,
		.allow_ddc_power_off = false,
		.allow_ddc_save = false,
	};
}

/* at_most: a smaller value is the stricter one. far: what no sane room asks for. */
static const struct rule {
	const char *key;
	size_t offset;
	bool at_most;
	double far;
} rules[] = {
	{ "flashes_per_s", offsetof(struct bb_safety, flashes_per_s), true, 0 },
	{ "fade_ms", offsetof(struct bb_safety, fade_ms), false, 60e3 },
	{ "transition_gap_s", offsetof(struct bb_safety, transition_gap_s), false, 3600 },
	{ "shutter_least_hz", offsetof(struct bb_safety, shutter_least_hz), false, 1000 },
	{ "holdover_most_s", offsetof(struct bb_safety, holdover_most_s), true, 0 },
	{ "white_cd_m2", offsetof(struct bb_safety, white_cd_m2), false, 10e3 },
	{ "outlet_least_off_s", offsetof(struct bb_safety, outlet_least_off_s), false, 86400 },
	{ "outlet_least_on_s", offsetof(struct bb_safety, outlet_least_on_s), false, 86400 },
	{ "outlet_cycles_per_hour", offsetof(struct bb_safety, outlet_cycles_per_hour), true, 0 },
	{ "outlet_stagger_ms", offsetof(struct bb_safety, outlet_stagger_ms), false, 600e3 },
};

static enum bb_status refuse(const char *key, double value, const char *bound, double limit,
                             const struct bb_where *where, struct bb_error *err)
{
	return bb_fail(err, BB_ERR_REFUSED, 1120, where, "%s: %g, %s %g", key, value, bound, limit);
}

enum bb_status bb_safety_tighten(struct bb_safety *s, const char *key, double value, const struct bb_where *where,
                                 struct bb_error *err)
{
	if (!strcmp(key, "allow_ddc_power_off") || !strcmp(key, "allow_ddc_save"))
		return value == 0 ? BB_OK : refuse(key, value, "always", 0, where, err);
	for (size_t i = 0; i < BB_ARRAY_LEN(rules); i++) {
		double *member = (double *)(void *)((char *)s + rules[i].offset);

		if (strcmp(rules[i].key, key))
			continue;
		/* Written so that NaN is refused. The member holds the ceiling or a stricter wish: never loosened. */
		if (rules[i].at_most ? !(value <= *member) : !(value >= *member))
			return refuse(key, value, rules[i].at_most ? "at most" : "at least", *member, where, err);
		if (rules[i].at_most ? value < rules[i].far : value > rules[i].far)
			return refuse(key, value, rules[i].at_most ? "at least" : "at most", rules[i].far, where, err);
		*member = value;
		return BB_OK;
	}
	return bb_fail(err, BB_ERR_CONFIG, 1011, where, "'%.48s' is no safety ceiling", key);
}

int64_t bb_safety_holdover_ns(const struct bb_safety *s, int64_t period_ns, double uncertainty_ppm)
{
	const double most_ns = s->holdover_most_s * 1e9;

	if (!(uncertainty_ppm >= 0))
		return 0;
	const double box_ns = 0.1 * (double)period_ns / (uncertainty_ppm * 1e-6);
	return (int64_t)(box_ns < most_ns ? box_ns : most_ns);
}
