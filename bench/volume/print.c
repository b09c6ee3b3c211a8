/* bench/volume/print.c: the measurements as Markdown. */
#include "bench/volume/tables.h"

#include <string.h>

static double number(const json_t *o, const char *key)
{
	return json_number_value(json_object_get(o, key));
}

static const char *text(const json_t *o, const char *key)
{
	const char *s = json_string_value(json_object_get(o, key));

	return s ? s : "";
}

/* Of each set and transfer function that has such a part. */
static void each(const json_t *root, const char *part, void (*print)(const json_t *of, const json_t *set))
{
	const json_t *set;
	size_t i;

	json_array_foreach(json_object_get(root, "sets"), i, set)
	{
		const json_t *of = json_object_get(set, part);
		if (of)
			print(of, set);
	}
}

static void print_edit(const json_t *o, const json_t *set)
{
	printf("| %s | %s | %.0f | %.1f | %.1f | %.1f | %.2f | %.1f | %.3f | %.3f | %.3f | %.3f |\n", text(set, "set"),
	       text(set, "transfer"), number(o, "bricks"), number(o, "edit_ms"), number(o, "edit_local_ms"),
	       number(o, "edit_histogram_ms"), number(o, "read_once_ms"), number(o, "reference_s"),
	       number(o, "rank_space"), number(o, "rank_space_histogram"), number(o, "rank_time"),
	       number(o, "rank_time_local"));
}

static void print_times(const json_t *o, const json_t *set)
{
	const bool kept = number(o, "sequence_mib") <= number(o, "memory_mib");
	const json_t *rows = json_object_get(o, "rows");

	printf("| %s | %s | | whole volume | %.2f | | %.2f | | |\n", text(set, "set"), text(set, "transfer"),
	       number(o, "step_mib"), kept ? 0 : number(o, "step_mib"));
	for (size_t i = 0; i < json_array_size(rows); i++) {
		const json_t *row = json_array_get(rows, i);
		printf("| %s | %s | %s | %s | %.2f | %.2f | %.2f | %.2f | %.1f |\n", text(set, "set"),
		       text(set, "transfer"), text(row, "error"), text(row, "selector"), number(row, "load_mib"),
		       number(row, "load_ms"), number(row, "again_mib"), number(row, "again_ms"),
		       number(row, "kept_mib"));
	}
}

static void print_shares(const json_t *o, const json_t *set)
{
	const json_t *rows = json_object_get(o, "rows");

	for (size_t i = 0; i < json_array_size(rows); i++) {
		const json_t *row = json_array_get(rows, i);
		printf("| %s | %s | %s | %s | %.0f | %.0f | %.0f | %.0f | %.2f | %.1f | %.3g | %.3g |\n",
		       text(set, "set"), text(set, "transfer"), text(row, "error"), text(row, "selector"),
		       number(row, "not_rendered"), number(row, "untextured"), number(row, "reused"),
		       number(row, "loaded"), number(row, "luv"), number(row, "psnr_db"), number(row, "space_most"),
		       number(row, "time_most"));
	}
}

static void print_head(const json_t *cells)
{
	printf("| gain |");
	for (size_t k = 0; k < json_array_size(cells); k++)
		printf(" %s 1/%.0f |", text(json_array_get(cells, k), "budget"),
		       number(json_array_get(cells, k), "part"));
	printf("\n|---|");
	for (size_t k = 0; k < json_array_size(cells); k++)
		printf("---:|");
	printf("\n");
}

static void print_budgets(const json_t *o, const json_t *set)
{
	const json_t *rows = json_object_get(o, "rows");

	printf("\n%s, %s, %.0f leaves, step %.0f: error left (%% of the root's) / distance in L\\*u\\*v\\*\n\n",
	       text(set, "set"), text(set, "transfer"), number(o, "leaves"), number(o, "step"));
	for (size_t i = 0; i < json_array_size(rows); i++) {
		const json_t *row = json_array_get(rows, i), *cells = json_object_get(row, "budgets");
		if (!i)
			print_head(cells);
		printf("| %s |", text(row, "selector"));
		for (size_t k = 0; k < json_array_size(cells); k++)
			printf(" %.2f / %.2f |", number(json_array_get(cells, k), "cost"),
			       number(json_array_get(cells, k), "luv"));
		printf("\n");
	}
}

static bool has(const json_t *root, const char *part)
{
	const json_t *set;
	size_t i;

	json_array_foreach(json_object_get(root, "sets"), i, set) if (json_object_get(set, part)) return true;
	return false;
}

void bb_tables_print(const json_t *root)
{
	if (has(root, "edits")) {
		printf("## An edit of the transfer function\n\n"
		       "Whole time trees; time one core ran, least of 5. Ranks: Spearman's correlation with the "
		       "reference "
		       "metrics.\n\n"
		       "| set | transfer | bricks | edit, ms | local in time, ms | by histogram, ms | reading once, ms "
		       "| reference, s | "
		       "rank, space | by histogram | rank, time | local in time |\n"
		       "|---|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n");
		each(root, "edits", print_edit);
	}
	if (has(root, "shares")) {
		printf("\n## Shares of voxels, per cent\n\n"
		       "slight: %.1f, moderate: %.1f mean distance in L\\*u\\*v\\* at most.\n\n"
		       "| set | transfer | error | selector | not rendered | untextured | reused | loaded | distance | "
		       "PSNR, dB | tolerance, space | time |\n"
		       "|---|---|---|---|---:|---:|---:|---:|---:|---:|---:|---:|\n",
		       BB_TABLES_SLIGHT_LUV, BB_TABLES_MODERATE_LUV);
		each(root, "shares", print_shares);
		printf("\n## Loads a step, not cached and cached\n\n"
		       "Cached: played once more, least recently used bricks leave %.0f MiB of memory. Time: bricks "
		       "times "
		       "what\none takes from the page cache here; drawing is not in it.\n\n"
		       "| set | transfer | error | selector | MiB | ms | cached, MiB | ms | needed in all, MiB |\n"
		       "|---|---|---|---|---:|---:|---:|---:|---:|\n",
		       (double)BB_TABLES_MEMORY_BYTES / 1048576);
		each(root, "shares", print_times);
	}
	if (has(root, "budgets"))
		printf("\n## Gains at middle budgets\n");
	each(root, "budgets", print_budgets);
}
