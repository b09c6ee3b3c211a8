#include "bench/trade/tell.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bench/file.h"
#include "bench/result.h"
#include "bench/trade/front.h"

/* ---- fronts and answers ---- */

enum quality { PSNR, SSIM };
enum cost { TIME, BYTES };

/* NULL: out of memory, or nothing there. */
static struct bb_front_point *points_of(const struct bb_trade_point *p, size_t n, enum quality quality, enum cost cost)
{
	struct bb_front_point *f = calloc(n ? n : 1, sizeof(*f));

	for (size_t i = 0; f && i < n; i++) {
		f[i].quality = p[i].failed ? (double)NAN : quality == PSNR ? p[i].psnr_db : p[i].ssim;
		f[i].cost = cost == TIME ? p[i].frame_ms : p[i].bytes_mean;
	}
	return f;
}

void bb_trade_mark(struct bb_trade_point *p, size_t n)
{
	for (int cost = TIME; cost <= BYTES; cost++) {
		struct bb_front_point *f = points_of(p, n, PSNR, (enum cost)cost);
		if (f)
			bb_front_mark(f, n);
		for (size_t i = 0; f && i < n; i++)
			*(cost == TIME ? &p[i].on_time_front : &p[i].on_bytes_front) = f[i].on_front;
		free(f);
	}
}

static struct bb_trade_answer answer(const struct bb_trade_told *t, enum quality quality, enum cost cost, bool best,
				     double limit)
{
	struct bb_trade_answer a = { .asked = isfinite(limit), .point = SIZE_MAX };
	struct bb_front_point *f = a.asked ? points_of(t->point, t->n, quality, cost) : NULL;

	if (f)
		a.point = best ? bb_front_best(f, t->n, limit) : bb_front_cheapest(f, t->n, limit);
	free(f);
	return a;
}

struct bb_trade_answers bb_trade_ask(const struct bb_trade_told *t)
{
	return (struct bb_trade_answers){ .within_ms = answer(t, PSNR, TIME, true, t->frame_ms),
					  .psnr_ms = answer(t, PSNR, TIME, false, t->psnr_db),
					  .psnr_bytes = answer(t, PSNR, BYTES, false, t->psnr_db),
					  .ssim_ms = answer(t, SSIM, TIME, false, t->ssim),
					  .ssim_bytes = answer(t, SSIM, BYTES, false, t->ssim) };
}

static bool met(const struct bb_trade_answer *a)
{
	return !a->asked || a->point != SIZE_MAX;
}

bool bb_trade_answered(const struct bb_trade_answers *a)
{
	return met(&a->within_ms) && met(&a->psnr_ms) && met(&a->ssim_ms);
}

/* ---- for people ---- */

static void print_row(const struct bb_trade_point *p, FILE *out)
{
	char text[128];

	bb_trade_setting_text(&p->setting, text, sizeof(text));
	fprintf(out, "%-9s %-58s", bb_trade_knob_text(p->knob), text);
	if (p->failed) {
		fprintf(out, " %s\n", p->why);
		return;
	}
	fprintf(out, "%7.2f %7.4f %6.2f %8.2f %8.2f %6.2f..%-7.2f %8.2f %7.2f %8.1f %8.1f %6.1f %8.2f  %s%s\n", p->psnr_db, p->ssim,
		p->luv, p->frame_ms, p->cpu_ms, p->draw_low_ms, p->draw_high_ms, p->stream_ms, (double)p->samples * 1e-6,
		p->bytes_mean / 1024, p->bytes_most / 1024, 100 * p->missing_share, (double)p->memory_bytes / 1048576,
		p->on_time_front ? "T" : " ", p->on_bytes_front ? "B" : " ");
}

static void print_answer(const struct bb_trade_told *t, const struct bb_trade_answer *a, FILE *out, const char *question)
{
	char text[128];

	if (!a->asked)
		return;
	if (a->point == SIZE_MAX) {
		fprintf(out, "%s: none of these settings\n", question);
		return;
	}
	const struct bb_trade_point *p = &t->point[a->point];
	fprintf(out, "%s: %s (%.2f dB, SSIM %.4f, %.2f ms, %.1f KiB a frame)\n", question,
		bb_trade_setting_text(&p->setting, text, sizeof(text)), p->psnr_db, p->ssim, p->frame_ms,
		p->bytes_mean / 1024);
}

static void print_answers(const struct bb_trade_told *t, FILE *out)
{
	const struct bb_trade_answers a = bb_trade_ask(t);
	char question[96];

	bb_text_format(question, sizeof(question), "best within %.4g ms a frame", t->frame_ms);
	print_answer(t, &a.within_ms, out, question);
	bb_text_format(question, sizeof(question), "fastest with %.4g dB", t->psnr_db);
	print_answer(t, &a.psnr_ms, out, question);
	bb_text_format(question, sizeof(question), "least streamed with %.4g dB", t->psnr_db);
	print_answer(t, &a.psnr_bytes, out, question);
	bb_text_format(question, sizeof(question), "fastest with SSIM %.4g", t->ssim);
	print_answer(t, &a.ssim_ms, out, question);
	bb_text_format(question, sizeof(question), "least streamed with SSIM %.4g", t->ssim);
	print_answer(t, &a.ssim_bytes, out, question);
}

void bb_trade_print(const struct bb_trade_told *t, FILE *out)
{
	fprintf(out, "%s: %s; %u frames at %d Hz, %u pictures of %u x %u\ncompared with %s\n\n", t->name, t->data, t->n_frames,
		BB_TRADE_RATE_HZ, t->n_drawn, t->width_px, t->height_px, t->reference);
	fprintf(out, "%-9s %-58s%7s %7s %6s %8s %8s %-15s %8s %7s %8s %8s %6s %8s\n", "", "", "PSNR", "SSIM", "L*u*v*", "frame",
		"CPU", "  drawing", "select,", "Msampl.", "streamed", "most", "not", "memory");
	fprintf(out, "%-9s %-58s%7s %7s %6s %8s %8s %-15s %8s %7s %8s %8s %6s %8s\n", "changed", "setting", "dB", "", "", "ms",
		"ms", "  ms, 10-90 %", "read ms", "a frame", "KiB/fr.", "KiB/fr.", "yet %", "MiB");
	for (size_t i = 0; i < t->n; i++)
		print_row(&t->point[i], out);
	fprintf(out, "\nT, B: no other setting has as many dB for less time, for fewer bytes\n");
	print_answers(t, out);
}

/* ---- for programs ---- */

static json_t *real(double v)
{
	return isfinite(v) ? json_real(v) : json_null();
}

static json_t *setting_json(const struct bb_trade_setting *s)
{
	json_t *o = json_pack("{s:s, s:b, s:f, s:i, s:s}", "selector", s->selector->name, "at_once", s->at_once, "step_voxels", s->step_voxels,
			      "brick", (int)s->brick, "type", bb_brick_type_text(s->type));

	json_object_set_new(o, "memory_mib", s->memory_mib > 0 ? json_real(s->memory_mib) : json_null());
	json_object_set_new(o, "bricks_per_frame", s->bricks_per_frame ? json_integer(s->bricks_per_frame) : json_null());
	json_object_set_new(o, "tolerance", s->selector->by_tolerance ? json_real(s->tolerance) : json_null());
	return o;
}

static json_t *point_json(const struct bb_trade_point *p)
{
	json_t *o = json_pack("{s:s, s:o}", "changed", bb_trade_knob_text(p->knob), "setting", setting_json(&p->setting));

	if (p->failed) {
		json_object_set_new(o, "why_not", json_string(p->why));
		return o;
	}
	json_object_set_new(o, "quality",
			    json_pack("{s:o, s:o, s:o, s:o}", "psnr_db", real(p->psnr_db), "psnr_least_db",
				      real(p->psnr_least_db), "ssim", real(p->ssim), "luv", real(p->luv)));
	json_object_set_new(
		o, "counted",
		json_pack("{s:I, s:I, s:f, s:f, s:f, s:f, s:f, s:I, s:I}", "rays", (json_int_t)p->rays, "samples",
			  (json_int_t)p->samples, "bytes_a_frame", p->bytes_mean, "bytes_most", p->bytes_most,
			  "bricks_a_frame", p->bricks_mean, "bricks_most", p->bricks_most, "missing_share",
			  p->missing_share, "memory_bytes", (json_int_t)p->memory_bytes, "atlas_bricks",
			  (json_int_t)p->atlas_bricks));
	json_object_set_new(o, "measured_ms",
			    json_pack("{s:o, s:o, s:o, s:o, s:o, s:o}", "cpu", real(p->cpu_ms), "frame", real(p->frame_ms), "draw", real(p->draw_ms),
				      "draw_10", real(p->draw_low_ms), "draw_90", real(p->draw_high_ms), "stream",
				      real(p->stream_ms)));
	json_object_set_new(o, "front_of_time", json_boolean(p->on_time_front));
	json_object_set_new(o, "front_of_bytes", json_boolean(p->on_bytes_front));
	return o;
}

static void add_answer(json_t *list, const char *question, double limit, const char *by, const struct bb_trade_answer *a)
{
	if (a->asked)
		json_array_append_new(list, json_pack("{s:s, s:f, s:s, s:o}", "question", question, "limit", limit, "by", by,
						      "point", a->point == SIZE_MAX ? json_null()
										    : json_integer((json_int_t)a->point)));
}

json_t *bb_trade_json(const struct bb_trade_told *t)
{
	const struct bb_trade_answers a = bb_trade_ask(t);
	json_t *points = json_array(), *answers = json_array();
	json_t *o = json_pack("{s:i, s:s, s:s, s:s, s:s, s:i, s:i, s:i, s:i}", "schema", BB_RESULT_SCHEMA, "kind",
			      "blackburst-trade-scene", "name", t->name, "data", t->data, "reference", t->reference, "frames",
			      (int)t->n_frames, "pictures", (int)t->n_drawn, "width_px", (int)t->width_px, "height_px",
			      (int)t->height_px);

	for (size_t i = 0; i < t->n; i++)
		json_array_append_new(points, point_json(&t->point[i]));
	json_object_set_new(o, "points", points);
	add_answer(answers, "best within frame_ms", t->frame_ms, "psnr_db", &a.within_ms);
	add_answer(answers, "cheapest with psnr_db", t->psnr_db, "frame_ms", &a.psnr_ms);
	add_answer(answers, "cheapest with psnr_db", t->psnr_db, "bytes_a_frame", &a.psnr_bytes);
	add_answer(answers, "cheapest with ssim", t->ssim, "frame_ms", &a.ssim_ms);
	add_answer(answers, "cheapest with ssim", t->ssim, "bytes_a_frame", &a.ssim_bytes);
	json_object_set_new(o, "answers", answers);
	return o;
}

static void put_number(FILE *f, double v)
{
	if (isfinite(v))
		fprintf(f, ",%.6g", v);
	else
		fputc(',', f);
}

enum bb_status bb_trade_csv(const struct bb_trade_told *t, const char *path, struct bb_error *err)
{
	struct bb_file f;
	const enum bb_status status = bb_file_begin(&f, path, err);

	if (status)
		return status;
	fputs("changed,selector,memory_mib,bricks_per_frame,tolerance,step_voxels,brick,type,psnr_db,psnr_least_db,ssim,luv,"
	      "frame_ms,cpu_ms,draw_ms,draw_10_ms,draw_90_ms,stream_ms,samples,bytes_a_frame,bytes_most,missing_share,memory_bytes,"
	      "front_of_time,front_of_bytes\n",
	      f.out);
	for (size_t i = 0; i < t->n; i++) {
		const struct bb_trade_point *p = &t->point[i];
		const struct bb_trade_setting *s = &p->setting;
		fprintf(f.out, "%s,%s,%.6g,%u,", bb_trade_knob_text(p->knob), s->selector->name, s->memory_mib,
			s->bricks_per_frame);
		if (s->selector->by_tolerance)
			fprintf(f.out, "%.6g", s->tolerance);
		fprintf(f.out, ",%.6g,%u,%s", s->step_voxels, s->brick, bb_brick_type_text(s->type));
		const double numbers[] = { p->psnr_db,     p->psnr_least_db, p->ssim,        p->luv,
					   p->frame_ms,    p->cpu_ms,        p->draw_ms,       p->draw_low_ms, p->draw_high_ms,
					   p->stream_ms,   (double)p->samples, p->bytes_mean, p->bytes_most,
					   p->missing_share, (double)p->memory_bytes };
		for (size_t k = 0; k < BB_ARRAY_LEN(numbers); k++)
			put_number(f.out, numbers[k]);
		fprintf(f.out, ",%d,%d\n", p->on_time_front, p->on_bytes_front);
	}
	return bb_file_commit(&f, err);
}
