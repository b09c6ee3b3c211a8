/* bench/calibrate/tell.c: see tell.h. */
#include "bench/calibrate/tell.h"

#include <math.h>
#include <string.h>

#include "bench/file.h"
#include "hal/file.h"

#define DEG_PER_RAD (180 / 3.14159265358979323846)
#define MOST_M 0.002
#define MOST_DEG 0.05
#define NOISE_SHARE 0.1

static double apart_m(const struct bb_camera_config *a, const struct bb_camera_config *b)
{
	return bb_vec3_norm(bb_vec3_sub(a->pose.p, b->pose.p));
}

static double apart_deg(const struct bb_camera_config *a, const struct bb_camera_config *b)
{
	return DEG_PER_RAD * bb_quat_angle(a->pose.q, b->pose.q);
}

void bb_calibrate_judge(struct bb_calibrate_outcome *o)
{
	const struct bb_calibration *c = o->calibration;

	o->worst_m = o->worst_deg = 0;
	o->n_wrong = o->n_found = o->n_falsely = 0;
	if (!o->dance)
		return;
	for (size_t i = 0; i < c->n_cameras; i++) {
		o->worst_m = fmax(o->worst_m, apart_m(&c->cameras[i], &o->dance->truth[i]));
		o->worst_deg = fmax(o->worst_deg, apart_deg(&c->cameras[i], &o->dance->truth[i]));
	}
	for (size_t i = 0; i < c->bundle.n_obs; i++) {
		const struct bb_bundle_obs *b = &c->bundle.obs[i];
		const struct bb_calibrate_camera *r = &c->report[b->camera];
		if (r->knocked && c->rod_ns[b->rod] < r->knocked_ns)
			continue;
		o->n_wrong += o->dance->wrong[b->source];
		o->n_found += o->dance->wrong[b->source] && b->out;
		o->n_falsely += !o->dance->wrong[b->source] && b->out;
	}
	o->holds = o->worst_m < MOST_M && o->worst_deg < MOST_DEG &&
	           fabs(c->rms_px - o->noise_px) < NOISE_SHARE * o->noise_px;
}

/* Text */

static void print_camera(const struct bb_calibrate_outcome *o, size_t i, FILE *out)
{
	const struct bb_camera_config *c = &o->calibration->cameras[i], *plan = &o->planned[i];
	const struct bb_calibrate_camera *r = &o->calibration->report[i];

	fprintf(out, "  %-8s %7zu %6zu %8.4f %6.0f%% %9.1f %8.2f %9.2f %8.2f %8.2f %8.4f %8.4f", c->id, r->n_used, r->n_out,
	        r->rms_px, 100 * r->covered, 1e3 * apart_m(c, plan), apart_deg(c, plan), c->fx_px, c->cx_px, c->cy_px, c->k1,
	        c->k2);
	if (o->dance)
		fprintf(out, " %8.3f %8.4f", 1e3 * apart_m(c, &o->dance->truth[i]), apart_deg(c, &o->dance->truth[i]));
	fputc('\n', out);
}

void bb_calibrate_print(const struct bb_calibrate_outcome *o, FILE *out)
{
	const struct bb_calibration *c = o->calibration;

	fprintf(out, "%s: %zu cameras\n", o->room->name, c->n_cameras);
	fprintf(out, "  wand       made out in %zu of %zu pictures with three blobs or more; %zu moments chosen\n", c->n_pictures,
	        c->n_lines, c->bundle.n_rods);
	fprintf(out, "  left over  %.4f px rms per coordinate, of %zu markers with %.0f degrees of freedom; %zu left out\n", c->rms_px,
	        c->n_used, c->freedom, c->n_out);
	fprintf(out, "  square     fits to %.3f mm rms, seen by %zu cameras\n", c->square_rms_mm, c->square_cameras);
	for (size_t i = 0; i < c->n_cameras; i++)
		if (c->report[i].knocked)
			fprintf(out, "  knocked    %s at %.1f s, by %.1f px: its place is what it saw since\n", c->cameras[i].id,
			        (double)c->report[i].knocked_ns * 1e-9, c->report[i].knock_px);
	fprintf(out, "  took       %u steps, %.2f s\n\n", c->steps, o->seconds);
	fprintf(out, "  %-8s %7s %6s %8s %7s %9s %8s %9s %8s %8s %8s %8s", "camera", "markers", "out", "rms_px", "covers",
	        "moved_mm", "by_deg", "focal_px", "x_px", "y_px", "k1", "k2");
	fprintf(out, o->dance ? " %8s %8s\n" : "\n", "off_mm", "off_deg");
	for (size_t i = 0; i < c->n_cameras; i++)
		print_camera(o, i, out);
	if (!o->dance)
		return;
	fprintf(out, "\n  against the truth: %.3f mm and %.4f degrees at most (2 and 0.05 allowed), noise %+.1f %% of what was put in (10)\n",
	        1e3 * o->worst_m, o->worst_deg, 100 * (c->rms_px / o->noise_px - 1));
	fprintf(out, "  outliers: %zu of %zu left out, and %zu markers beside them: %s\n", o->n_found, o->n_wrong, o->n_falsely,
	        o->holds ? "holds" : "DOES NOT HOLD");
}

/* JSON */

static json_t *camera_json(const struct bb_calibrate_outcome *o, size_t i)
{
	const struct bb_camera_config *c = &o->calibration->cameras[i];
	const struct bb_calibrate_camera *r = &o->calibration->report[i];
	const struct bb_pose *p = &c->pose;
	json_t *j = json_pack("{s:s, s:[fff], s:[ffff], s:f, s:[ff], s:f, s:f, s:I, s:I, s:f, s:f, s:b}", "id", c->id, "position_m",
	                      p->p.x, p->p.y, p->p.z, "turned", p->q.x, p->q.y, p->q.z, p->q.w, "focal_px", c->fx_px,
	                      "centre_px", c->cx_px, c->cy_px, "k1", c->k1, "k2", c->k2, "markers", (json_int_t)r->n_used, "out",
	                      (json_int_t)r->n_out, "rms_px", r->rms_px, "covered", r->covered, "knocked", r->knocked);

	if (r->knocked) {
		json_object_set_new(j, "knocked_s", json_real((double)r->knocked_ns * 1e-9));
		json_object_set_new(j, "knock_px", json_real(r->knock_px));
	}
	json_object_set_new(j, "moved_mm", json_real(1e3 * apart_m(c, &o->planned[i])));
	if (o->dance) {
		json_object_set_new(j, "off_mm", json_real(1e3 * apart_m(c, &o->dance->truth[i])));
		json_object_set_new(j, "off_deg", json_real(apart_deg(c, &o->dance->truth[i])));
	}
	return j;
}

json_t *bb_calibrate_json(const struct bb_calibrate_outcome *o)
{
	const struct bb_calibration *c = o->calibration;
	json_t *cameras = json_array();
	json_t *root = json_pack("{s:s, s:I, s:I, s:I, s:I, s:I, s:f, s:f, s:f, s:I, s:I, s:I}", "room", o->room->name, "pictures",
	                         (json_int_t)c->n_pictures, "lines", (json_int_t)c->n_lines, "moments",
	                         (json_int_t)c->bundle.n_rods, "markers", (json_int_t)c->n_used, "out", (json_int_t)c->n_out,
	                         "freedom", c->freedom, "rms_px", c->rms_px, "square_rms_mm", c->square_rms_mm, "square_cameras",
	                         (json_int_t)c->square_cameras, "knocked", (json_int_t)c->n_knocked, "steps", (json_int_t)c->steps);

	for (size_t i = 0; i < c->n_cameras; i++)
		json_array_append_new(cameras, camera_json(o, i));
	if (o->dance)
		json_object_set_new(root, "truth",
		                    json_pack("{s:f, s:f, s:f, s:I, s:I, s:I, s:b}", "worst_mm", 1e3 * o->worst_m, "worst_deg",
		                              o->worst_deg, "noise_px", o->noise_px, "outliers", (json_int_t)o->n_wrong,
		                              "outliers_found", (json_int_t)o->n_found, "left_out_falsely", (json_int_t)o->n_falsely,
		                              "holds", o->holds));
	json_object_set_new(root, "cameras", cameras);
	return root;
}

/* Files */

enum bb_status bb_calibrate_spare(const struct bb_cli *cli, const char *input, struct bb_error *err)
{
	static const char *const outputs[] = { "out", "save", "svg", "png" };

	for (size_t i = 0; input && i < BB_ARRAY_LEN(outputs); i++)
		if (bb_path_is_same(bb_cli_get(cli, outputs[i], ""), input))
			return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "--%s would take the place of %s", outputs[i], input);
	return BB_OK;
}

void bb_calibrate_head(const struct bb_room *planned, const char *made, struct bb_calibration_head *out)
{
	static const uint8_t nothing[BB_HASH_BYTES];

	*out = (struct bb_calibration_head){ .moved = BB_POSE_IDENTITY };
	bb_text_clean(out->room, sizeof(out->room), planned->name);
	bb_text_clean(out->made, sizeof(out->made), made);
	for (char *at = out->room; *at; at++)
		*at = *at == '"' || *at == '\\' ? '?' : *at;
	for (char *at = out->made; *at; at++)
		*at = *at == '"' || *at == '\\' ? '?' : *at;
	bb_hash_hex(planned->sha256, out->room_sha256);
	bb_hash_hex(nothing, out->sequence_sha256);
	bb_calibration_hash(planned->cameras, planned->n_cameras, out->cameras_sha256);
}

enum bb_status bb_calibrate_save(const char *file, const struct bb_calibration_head *head,
                                 const struct bb_camera_config *cameras, size_t n, struct bb_error *err)
{
	struct bb_file f;
	const enum bb_status status = bb_file_begin(&f, file, err);

	if (status)
		return status;
	bb_calibration_write(f.out, head, cameras, n);
	return bb_file_commit(&f, err);
}

enum bb_status bb_calibrate_save_sequence(const char *file, const struct bb_sequence *s, struct bb_error *err)
{
	struct bb_file f;
	const enum bb_status status = bb_file_begin(&f, file, err);
	int square = -1;

	if (status)
		return status;
	fprintf(f.out, "# blackburst wand 1\nwand_mm %g %g %g\nsquare_mm", 1e3 * s->along_m[0], 1e3 * s->along_m[1],
	        1e3 * s->along_m[2]);
	for (int i = 0; i < 4; i++)
		fprintf(f.out, "  %g %g %g", 1e3 * s->square[i].x, 1e3 * s->square[i].y, 1e3 * s->square[i].z);
	fputc('\n', f.out);
	for (size_t i = 0; i < s->n_cameras; i++)
		fprintf(f.out, "camera %s\n", s->ids[i]);
	for (size_t i = 0; i < s->n_sights; i++) {
		const struct bb_sequence_sight *sight = &s->sights[i];
		if (square != sight->square)
			fprintf(f.out, "part %s\n", sight->square ? "square" : "wand");
		square = sight->square;
		fprintf(f.out, "%.6f %s", (double)sight->t_ns * 1e-9, s->ids[sight->camera]);
		for (size_t k = 0; k < sight->n; k++)
			fprintf(f.out, " %.4f %.4f", (double)s->px[sight->first + k][0], (double)s->px[sight->first + k][1]);
		fputc('\n', f.out);
	}
	return bb_file_commit(&f, err);
}
