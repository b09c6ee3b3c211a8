/*
 * tests/fuzz/fuzz_nifti.c: any bytes as a NIfTI-1 file and its voxels. The file is in memory: the functions of
 * render/volume/bytes.c stand here for that, so that no input costs a system call. A file of odd length is packed: its
 * header may claim more than there is; one of length 4 n + 3 is packed and damaged at its end; an empty one cannot be
 * opened.
 */
#include "render/volume/volume_private.h"
#include "tests/fuzz/fuzz.h"

#define CAP_BYTES (4u << 20)

static struct fuzz_input file; /* what is not read yet */
static const uint8_t *begin;
static size_t n_file;

enum bb_status bb_bytes_open(const char *path, unsigned int mode, struct bb_bytes *out, struct bb_error *err)
{
	(void)mode;
	*out = (struct bb_bytes){ .where = { path, 0, 0 }, .fd = -1, .file_bytes = n_file };
	return n_file ? BB_OK : bb_fail(err, BB_ERR_CONFIG, 1001, &out->where, "empty");
}

void bb_bytes_close(struct bb_bytes *b)
{
	(void)b;
}

enum bb_status bb_bytes_rewind(struct bb_bytes *b, struct bb_error *err)
{
	(void)b;
	(void)err;
	file = (struct fuzz_input){ begin, n_file };
	return BB_OK;
}

enum bb_status bb_bytes_read(struct bb_bytes *b, void *buf, size_t n, size_t *n_out, struct bb_error *err)
{
	*n_out = n < file.left ? n : file.left;
	if (n_file % 4 == 3 && *n_out < n)
		return bb_fail(err, BB_ERR_FORMAT, 1408, &b->where, "damaged");
	memcpy(buf, file.at, *n_out);
	file.at += *n_out;
	file.left -= *n_out;
	return BB_OK;
}

enum bb_status bb_bytes_could_hold(const struct bb_bytes *b, uint64_t n, struct bb_error *err)
{
	if (n <= b->file_bytes * (b->file_bytes & 1 ? 1000 : 1))
		return BB_OK;
	return bb_fail(err, BB_ERR_FORMAT, 1406, &b->where, "too few bytes");
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	struct bb_volume *v = NULL;
	struct bb_error err = { 0 };

	begin = data;
	n_file = size;
	file = (struct fuzz_input){ data, size };
	if (bb_volume_load_nifti("fuzz", CAP_BYTES, &v, &err) != BB_OK) {
		fuzz_must(!v && err.number >= 1000);
		return 0;
	}
	const uint64_t n = (uint64_t)v->dim[0] * v->dim[1] * v->dim[2] * v->n_steps;
	fuzz_must(n && n * sizeof(uint16_t) <= CAP_BYTES && v->n_nonfinite <= n && v->least <= v->most);
	for (int i = 0; i < 3; i++)
		fuzz_must(v->spacing_mm[i] >= 1e-6 && v->spacing_mm[i] <= 1e6);
	(void)bb_volume_voxel(v, INT64_MAX, INT64_MAX, INT64_MAX, UINT32_MAX);
	bb_volume_free(v);
	return 0;
}
