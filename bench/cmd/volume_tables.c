/* bench/cmd/volume_tables.c: `blackburst volume tables`: the selectors on generated data, as the papers' tables. */
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "bench/cli.h"
#include "bench/file.h"
#include "bench/volume/tables.h"

static const struct bb_cli_option options[] = {
	{ "set", "NAME", "one data set: small-delta, large-delta, f18, shock or enlil (edits only)" },
	{ "part", "edits|shares|budgets", "one kind of table" },
	{ "scale", "PERCENT", "of the voxels along each axis and of the steps (default 100)" },
	{ "brick", "N", "voxels along a brick's edge (default 32, for budgets 16)" },
	{ "folder", "FOLDER", "for the brick files, which are removed again (default /tmp)" },
	{ "json", NULL, "machine-readable" },
	{ NULL, NULL, NULL },
};

static void say(const char *what)
{
	fprintf(stderr, "\r%-40s", what);
	fflush(stderr);
}

typedef enum bb_status (*measure_fn)(struct bb_tables *t, json_t **out, struct bb_error *err);

static const struct part {
	const char *name;
	double brick;
	measure_fn measure;
} parts[] = {
	{ "edits", 32, bb_tables_edits },
	{ "shares", 32, bb_tables_shares },
	{ "budgets", 16, bb_tables_budgets },
};

struct job {
	const struct bb_cli *cli;
	struct bb_clock *clk;
	double scale, brick; /* brick 0: as the part has it */
	char path[BB_PATH_MAX_BYTES];
	json_t *sets;
};

static bool wanted(const struct job *j, const char *option, const char *name)
{
	return !strcmp(bb_cli_get(j->cli, option, name), name);
}

/* 0: there is no such table of this set, or nobody wants it. */
static double brick_of(const struct job *j, const struct bb_tables_set *set, const struct part *p)
{
	if (!wanted(j, "part", p->name) || (set->brick && p != parts))
		return 0;
	return j->brick > 0 ? j->brick : set->brick ? set->brick : p->brick;
}

/* All parts of one brick size, under one transfer function. */
static enum bb_status measure(const struct job *j, const struct bb_tables_set *set, const struct bb_transfer *tf,
			      double brick, json_t *out, struct bb_error *err)
{
	struct bb_tables t;
	enum bb_status status = bb_tables_begin(&t, j->path, tf, j->clk, err);

	t.progress = isatty(STDERR_FILENO) ? say : NULL;
	for (size_t i = 0; i < BB_ARRAY_LEN(parts) && !status; i++) {
		json_t *made = NULL;
		if (fabs(brick_of(j, set, &parts[i]) - brick) > 0)
			continue;
		status = parts[i].measure(&t, &made, err);
		if (!status)
			json_object_set_new(out, parts[i].name, made);
	}
	bb_tables_end(&t);
	return status;
}

static enum bb_status measure_set(struct job *j, const struct bb_tables_set *set, double brick, struct bb_error *err)
{
	static const char *const transfers[] = { "sparse", "filled" };
	enum bb_status status = bb_tables_build(set, j->scale, (uint32_t)brick, j->path, err);

	for (size_t i = 0; i < BB_ARRAY_LEN(transfers) && !status; i++) {
		static struct bb_transfer tf; /* one thread */
		char path[BB_PATH_MAX_BYTES];
		json_t *out = json_pack("{s:s, s:s, s:f}", "set", set->name, "transfer", transfers[i], "brick", brick);
		bb_text_format(path, sizeof(path), "scenes/%s-%s.tf", set->tf, transfers[i]);
		status = bb_transfer_load(path, &tf, err);
		if (!status)
			status = measure(j, set, &tf, brick, out, err);
		json_array_append_new(j->sets, out);
	}
	unlink(j->path);
	return status;
}

/* One file for all parts of a size of bricks. */
static enum bb_status measure_sizes(struct job *j, const struct bb_tables_set *set, bool *any, struct bb_error *err)
{
	double before = 0;

	for (size_t i = 0; i < BB_ARRAY_LEN(parts); i++) {
		const double brick = brick_of(j, set, &parts[i]);
		if (!(brick > 0) || !(fabs(brick - before) > 0))
			continue;
		before = brick;
		*any = true;
		const enum bb_status status = measure_set(j, set, brick, err);
		if (status)
			return status;
	}
	return BB_OK;
}

static enum bb_status measure_all(struct job *j, struct bb_error *err)
{
	bool any = false;

	for (const struct bb_tables_set *set = bb_tables_sets; set->name; set++) {
		const enum bb_status status = wanted(j, "set", set->name) ? measure_sizes(j, set, &any, err) : BB_OK;
		if (status)
			return status;
	}
	return any ? BB_OK
		   : bb_fail(err, BB_ERR_USAGE, 1460, NULL, "set '%.40s', part '%.40s'",
			     bb_cli_get(j->cli, "set", "any"), bb_cli_get(j->cli, "part", "any"));
}

static int command(const struct bb_cli *cli)
{
	struct job j = { .cli = cli };
	struct bb_error err = { 0 };
	enum bb_status status = bb_cli_number(cli, "scale", 100, 1, 400, &j.scale, &err);

	if (!status)
		status = bb_cli_whole(cli, "brick", 0, 4, 64, &j.brick, &err);
	if (!status)
		status = bb_clock_posix_create(&j.clk);
	if (status)
		return bb_cli_fail(status, &err);
	bb_text_format(j.path, sizeof(j.path), "%s/blackburst-tables-%ld.bricks", bb_cli_get(cli, "folder", "/tmp"),
		       (long)getpid());
	j.sets = json_array();
	status = measure_all(&j, &err);
	bb_clock_destroy(j.clk);
	if (isatty(STDERR_FILENO))
		fprintf(stderr, "\r%40s\r", "");
	json_t *root = json_pack("{s:f, s:f, s:f, s:o}", "scale", j.scale, "slight_luv", BB_TABLES_SLIGHT_LUV,
				 "moderate_luv", BB_TABLES_MODERATE_LUV, "sets", j.sets);
	if (!status && bb_cli_has(cli, "json"))
		return bb_cli_print_json(root);
	if (!status)
		bb_tables_print(root);
	json_decref(root);
	return status ? bb_cli_fail(status, &err) : BB_EXIT_OK;
}

const struct bb_command bb_cmd_volume_tables = {
	"volume tables",
	"ways of choosing bricks, compared on generated data of published sizes",
	"[--set NAME] [--part PART] [--scale PERCENT] [--json]",
	options,
	0,
	0,
	command,
};
