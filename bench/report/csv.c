/*
 * bench/report/csv.c: frames.csv, a line a frame; units stand in the column names, NA is "not measured", the node is
 * its id. Column names never change meaning; new ones are added at the end. One thread.
 */
#include "bench/file.h"
#include "bench/latency.h"
#include "bench/result.h"

#include <math.h>

static void put_number(FILE *f, double v)
{
	if (isfinite(v))
		fprintf(f, ",%.6g", v);
	else
		fputs(",NA", f);
}

static void put_flags(FILE *f, unsigned flags)
{
	static const struct {
		unsigned flag;
		const char *name;
	} names[] = { { BB_FRAME_TORN, "torn" }, { BB_FRAME_EYES_SWAPPED, "eyes_swapped" }, { BB_FRAME_MONO, "mono" },
		      { BB_FRAME_POSE_OLD, "pose_old" }, { BB_FRAME_VIEW_CLAMPED, "view_clamped" } };
	const char *separator = ",";

	for (size_t i = 0; i < BB_ARRAY_LEN(names); i++)
		if (flags & names[i].flag) {
			fprintf(f, "%s%s", separator, names[i].name);
			separator = "+";
		}
	fputs(flags ? "" : ",NA", f);
}

static void put_row(FILE *f, const struct bb_run_result *r, const struct bb_frame_row *row)
{
	fprintf(f, "%llu,%lld,%.9f", (unsigned long long)row->frame, (long long)row->start_ns,
	        (double)row->start_ns * 1e-9 - r->scene_start_s);
	put_number(f, row->head_to_photon_ms);
	put_number(f, row->frame_ms);
	put_number(f, row->swap_skew_us);
	put_number(f, row->scanout_skew_us);
	put_number(f, row->phase_us);
	put_number(f, row->pose_age_ms);
	put_number(f, row->pose_error_mm);
	put_number(f, row->photon_error_mm);
	fprintf(f, ",%u,%u,%u,%u,%llu,", row->cameras, row->bricks_wanted, row->bricks_missing, row->bricks_loaded,
	        (unsigned long long)row->bytes);
	if (row->late_node < r->room->n_nodes)
		bb_put_csv(f, r->room->nodes[row->late_node].id);
	else
		fputs("NA", f);
	put_flags(f, row->flags);
	fprintf(f, ",%llu", (unsigned long long)row->deficit);
	put_number(f, row->upload_ms);
	put_number(f, row->photon_error_deg);
	put_number(f, row->unpredicted_mm);
	put_number(f, row->unpredicted_deg);
	put_number(f, row->pose_sigma_mm);
	put_number(f, row->solved_sigma_mm);
	for (int i = 0; i < BB_LINK_COUNT; i++)
		if (row->chained)
			fprintf(f, ",%.3f", row->link_ns[i] * 1e-3);
		else
			fputs(",NA", f);
	fputs("\n", f);
}

enum bb_status bb_result_write_csv(const struct bb_run_result *r, const char *path, struct bb_error *err)
{
	const struct bb_frame_row *row;
	const size_t n = bb_ledger_rows(r->ledger, &row);
	struct bb_file f;
	enum bb_status st = bb_file_begin(&f, path, err);

	if (st != BB_OK)
		return st;
	fputs("frame,start_clock_ns,start_scene_s,head_to_photon_ms,frame_ms,swap_skew_us,scanout_skew_us,phase_us,"
	      "pose_age_ms,pose_error_mm,photon_error_mm,cameras_count,bricks_wanted_count,bricks_missing_count,"
	      "bricks_loaded_count,streamed_bytes,late_node,flags,"
	      "level_deficit_cells,brick_load_ms,"
	      "photon_error_deg,unpredicted_error_mm,unpredicted_error_deg,pose_sigma_mm,solved_sigma_mm",
	      f.out);
	for (int i = 0; i < BB_LINK_COUNT; i++)
		fprintf(f.out, ",link_%s_us", bb_latency_name((enum bb_link_id)i));
	fputs("\n", f.out);
	for (size_t i = 0; i < n; i++)
		put_row(f.out, r, &row[i]);
	return bb_file_commit(&f, err);
}
