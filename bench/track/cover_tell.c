/* bench/track/cover_tell.c: coverage as a table, JSON and CSV. */
#include <math.h>

#include "bench/file.h"
#include "bench/track/cover.h"

static const char *mm(char *out, size_t cap, double m)
{
	if (!isfinite(m))
		bb_text_format(out, cap, "none");
	else
		bb_text_format(out, cap, "%.3f", 1e3 * m);
	return out;
}

void bb_cover_print(const struct bb_cover *c, const struct bb_cover_summary s[BB_COVERAGE_BODIES],
		    const unsigned *levels, size_t n_levels, FILE *f)
{
	const struct bb_coverage_grid *g = &c->grid;
	char a[32], b[32], d[32], e[32];

	fprintf(f,
		"%s: %zu cameras; %zu of %zu x %zu x %zu voxels of %g mm lie in the room; a marker of %g mm, seen at %g px "
		"or more\nand %g to %g m; the viewer turns through %u headings. Share of the volume seen by at least so many "
		"cameras,\nand expected error of a marker's position in mm (p50, p90: so many of 100 voxels are better; none: "
		"no position;\nworst axis: p90 along it; weakest decile: harmonic mean over it):\n\n",
		c->room->name, c->room->n_cameras, c->n_inside, g->n[0], g->n[1], g->n[2], 1e3 * g->step_m,
		1e3 * c->config.marker_m, c->config.least_px, c->config.near_m, c->config.far_m, c->config.headings);
	fprintf(f, "%-7s", "viewer");
	for (size_t i = 0; i < n_levels; i++)
		fprintf(f, "  >=%-2u %%", levels[i]);
	fprintf(f, "  placed %%  p10 cameras  p50 mm   p90 mm   worst axis  weakest decile\n");
	for (int k = 0; k < BB_COVERAGE_BODIES; k++) {
		fprintf(f, "%-7s", bb_cover_body_text((enum bb_coverage_body)k));
		for (size_t i = 0; i < n_levels; i++)
			fprintf(f, "  %6.1f", 100 * s[k].share[i]);
		fprintf(f, "  %8.1f  %11.2f  %-7s  %-7s  %-10s  %s\n", 100 * s[k].placed, s[k].p10_n, mm(a, sizeof(a), s[k].p50_m),
			mm(b, sizeof(b), s[k].p90_m), mm(d, sizeof(d), s[k].worst_p90_m), mm(e, sizeof(e), s[k].weak_m));
	}
}

static json_t *number(double m)
{
	return isfinite(m) ? json_real(1e3 * m) : json_null();
}

json_t *bb_cover_json(const struct bb_cover *c, const struct bb_cover_summary s[BB_COVERAGE_BODIES],
		      const unsigned *levels, size_t n_levels)
{
	const struct bb_coverage_grid *g = &c->grid;
	json_t *bodies = json_object();

	for (int k = 0; k < BB_COVERAGE_BODIES; k++) {
		json_t *shares = json_object();
		for (size_t i = 0; i < n_levels; i++) {
			char key[16];
			bb_text_format(key, sizeof(key), "%u", levels[i]);
			json_object_set_new(shares, key, json_real(s[k].share[i]));
		}
		json_object_set_new(bodies, bb_cover_body_text((enum bb_coverage_body)k),
				    json_pack("{s:o, s:f, s:f, s:o, s:o, s:o, s:o}", "share_at_least", shares, "placed",
					      s[k].placed, "p10_cameras", s[k].p10_n, "p50_mm", number(s[k].p50_m),
					      "p90_mm", number(s[k].p90_m), "p90_worst_axis_mm",
					      number(s[k].worst_p90_m), "weakest_decile_mm", number(s[k].weak_m)));
	}
	return json_pack("{s:s, s:s, s:I, s:f, s:[I,I,I], s:I, s:f, s:f, s:i, s:o}", "kind", "blackburst-coverage", "room",
			 c->room->name, "cameras", (json_int_t)c->room->n_cameras, "voxel_mm", 1e3 * g->step_m, "voxels",
			 (json_int_t)g->n[0], (json_int_t)g->n[1], (json_int_t)g->n[2], "inside",
			 (json_int_t)c->n_inside, "marker_mm", 1e3 * c->config.marker_m, "least_px", c->config.least_px,
			 "headings", (int)c->config.headings, "viewer", bodies);
}

static void line(FILE *f, struct bb_vec3 p, const struct bb_coverage_voxel *v)
{
	fprintf(f, "%.1f,%.1f,%.1f,%.0f,%.2f,%.0f,%.2f", 1e3 * p.x, 1e3 * p.y, 1e3 * p.z,
		(double)v->n[BB_COVERAGE_NONE], (double)v->n[BB_COVERAGE_MEAN], (double)v->n[BB_COVERAGE_WORST],
		(double)v->lost);
	for (int k = 0; k < BB_COVERAGE_BODIES; k++)
		fprintf(f, ",%.4g,%.4g", 1e3 * (double)v->error_m[k], 1e3 * (double)v->worst_m[k]);
	fputc('\n', f);
}

enum bb_status bb_cover_csv(const struct bb_cover *c, const char *path, struct bb_error *err)
{
	const struct bb_coverage_grid *g = &c->grid;
	struct bb_file file;
	const enum bb_status status = bb_file_begin(&file, path, err);

	if (status)
		return status;
	fprintf(file.out, "x_mm,y_mm,z_mm,cameras_none,cameras_mean,cameras_worst,lost_share,error_none_mm,axis_none_mm,"
			  "error_mean_mm,axis_mean_mm,error_worst_mm,axis_worst_mm\n");
	for (size_t i = 0, y = 0; y < g->n[1]; y++)
		for (size_t z = 0; z < g->n[2]; z++)
			for (size_t x = 0; x < g->n[0]; x++, i++)
				if (c->voxels[i].inside)
					line(file.out, bb_coverage_centre(g, x, y, z), &c->voxels[i]);
	return bb_file_commit(&file, err);
}
