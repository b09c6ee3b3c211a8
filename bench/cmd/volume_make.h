/* bench/cmd/volume_make.h: what `volume build` and `volume generate` share: a sequence made by its options, and work that
 * takes so long that it shows how far it is and can be stopped. */
#ifndef BB_BENCH_CMD_VOLUME_MAKE_H
#define BB_BENCH_CMD_VOLUME_MAKE_H

#include "bench/cli.h"
#include "hal/clock.h"
#include "render/volume/steps.h"

/* By --dim, --steps and --seed. 1430, 1431, 1701, 1704. */
BB_MUST_CHECK enum bb_status bb_volume_make(const struct bb_cli *cli, const char *kind, struct bb_steps **out,
					    struct bb_error *err);
/* --threads; one for each processor. 1704. */
BB_MUST_CHECK enum bb_status bb_volume_threads(const struct bb_cli *cli, unsigned *out, struct bb_error *err);

struct bb_volume_work {
	const char *unit; /* "bricks" */
	struct bb_clock *clk;
	int64_t begun_ns;
	uint64_t first; /* done before this call */
	int permille;
	bool shown, started;
};
/* From here on SIGINT and SIGTERM make the progress say stop; a second one ends the process. */
BB_MUST_CHECK enum bb_status bb_volume_work_begin(struct bb_volume_work *w, const struct bb_cli *cli, const char *unit,
						  struct bb_error *err);
bool bb_volume_work_progress(void *work, uint64_t done, uint64_t total); /* as builders call it */
double bb_volume_work_end(struct bb_volume_work *w);                     /* seconds; nothing when it never began */

#endif
