/* bench/cmd/track_cover.h: options that `track coverage` and `track place` share. */
#ifndef BB_BENCH_CMD_TRACK_COVER_H
#define BB_BENCH_CMD_TRACK_COVER_H

#include "bench/cli.h"
#include "bench/track/cover.h"

/* --voxel-mm (or `voxel_mm`), --box, --marker-mm, --least-px, --noise-px, --headings, --threads. 1701, 1704, 1752. */
BB_MUST_CHECK enum bb_status bb_cover_wish(const struct bb_cli *cli, double voxel_mm, struct bb_cover_wishes *out,
					   struct bb_error *err);
/* --body, else `usual`. 1753. */
BB_MUST_CHECK enum bb_status bb_cover_body(const struct bb_cli *cli, enum bb_coverage_body usual,
					   enum bb_coverage_body *out, struct bb_error *err);
/* Makes the folder of --out if it is not there, and a path in it. 1754. */
BB_MUST_CHECK enum bb_status bb_cover_folder(const char *dir, struct bb_error *err);

#endif
