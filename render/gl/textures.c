/*
 * render/gl/textures.c: keeps the GL copy of an atlas. Only what changed is sent: slots by their generation, the slot
 * map when it differs, a coarse step when time moves on, the table when the transfer function or the step length
 * changes.
 *
 * Units: even steps live in one coarse texture and odd ones in the other, so that a pair of neighbours is always on
 * hand and moving on by one step sends one of them.
 */
#include "render/gl/textures.h"

#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#if 0 /* drawn from the new atlas soon */
#define NO_STEP UINT32_MAX
#define EMPTY (-2)
#define COARSE (-1)

static void bind(const struct bb_gl *gl, const struct bb_gl_textures *t, enum bb_gl_unit unit)
{
	gl->ActiveTexture(GL_TEXTURE0 + (GLenum)unit);
	gl->BindTexture(unit == BB_GL_TRANSFER ? GL_TEXTURE_1D : GL_TEXTURE_3D, t->name[unit]);
}

void bb_gl_textures_init(struct bb_gl_textures *t, const struct bb_gl *gl)
{
	*t = (struct bb_gl_textures){ .coarse_step = { NO_STEP, NO_STEP } };
	gl->GenTextures(BB_GL_UNITS, t->name);
	gl->GetIntegerv(GL_MAX_3D_TEXTURE_SIZE, &t->max_3d);
	for (int u = 0; u < BB_GL_UNITS; u++) {
		const GLenum target = u == BB_GL_TRANSFER ? GL_TEXTURE_1D : GL_TEXTURE_3D;
		const GLint filter = u == BB_GL_SLOTS ? GL_NEAREST : GL_LINEAR;
		bind(gl, t, (enum bb_gl_unit)u);
		gl->TexParameteri(target, GL_TEXTURE_MIN_FILTER, filter);
		gl->TexParameteri(target, GL_TEXTURE_MAG_FILTER, filter);
		gl->TexParameteri(target, GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
		gl->TexParameteri(target, GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
		gl->TexParameteri(target, GL_TEXTURE_WRAP_R, GL_CLAMP_TO_EDGE);
		gl->TexParameteri(target, GL_TEXTURE_MAX_LEVEL, 0);
	}
	gl->PixelStorei(GL_UNPACK_ALIGNMENT, 1);
}

void bb_gl_textures_release(struct bb_gl_textures *t, const struct bb_gl *gl)
{
	gl->DeleteTextures(BB_GL_UNITS, t->name);
	free(t->seen);
	free(t->map);
	*t = (struct bb_gl_textures){ 0 };
}

static size_t cells_of(const struct bb_atlas *atlas)
{
	return (size_t)atlas->grid[0] * atlas->grid[1] * atlas->grid[2];
}

/* Slots side by side in a block as near to a cube as the driver's limit asks for. */
static bool lay_out(struct bb_gl_textures *t, uint32_t n_slots)
{
	const uint32_t most = (uint32_t)t->max_3d / BB_BRICK_STORED < 256 ? (uint32_t)t->max_3d / BB_BRICK_STORED : 256;
	const uint32_t n = n_slots ? n_slots : 1;
	const uint32_t edge = (uint32_t)ceil(cbrt((double)n));

	t->slots_across[0] = edge;
	t->slots_across[1] = edge;
	t->slots_across[2] = (n + edge * edge - 1) / (edge * edge);
	return edge <= most;
}

static enum bb_status adopt(struct bb_gl_textures *t, const struct bb_gl *gl, const struct bb_draw *draw,
			    struct bb_error *err)
{
	const struct bb_atlas *atlas = bb_stream_atlas(draw->stream);
	const size_t n_cells = cells_of(atlas);

	free(t->seen);
	free(t->map);
	t->stream = NULL;
	t->transfer = NULL;
	t->map_valid = false;
	t->coarse_step[0] = t->coarse_step[1] = NO_STEP;
	t->seen = calloc(atlas->n_slots + (size_t)1, sizeof(*t->seen));
	t->map = calloc(n_cells, 2 * sizeof(*t->map));
	if (!t->seen || !t->map)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "maps of %zu bricks", n_cells);
	memset(t->seen, 0xFF, atlas->n_slots * sizeof(*t->seen)); /* no generation is that old */
	t->generation = UINT64_MAX;
	if (!lay_out(t, atlas->n_slots))
		return bb_fail(err, BB_ERR_RANGE, 1805, NULL, "%" PRIu32 " bricks, textures end at %d", atlas->n_slots,
			       t->max_3d);
	bind(gl, t, BB_GL_ATLAS);
	gl->TexImage3D(GL_TEXTURE_3D, 0, GL_R16, (GLsizei)t->slots_across[0] * BB_BRICK_STORED,
		       (GLsizei)t->slots_across[1] * BB_BRICK_STORED, (GLsizei)t->slots_across[2] * BB_BRICK_STORED, 0,
		       GL_RED, GL_UNSIGNED_SHORT, NULL);
	t->stream = draw->stream;
	return BB_OK;
}

static void slot_place(const struct bb_gl_textures *t, uint32_t slot, uint32_t at[3])
{
	at[0] = slot % t->slots_across[0];
	at[1] = slot / t->slots_across[0] % t->slots_across[1];
	at[2] = slot / t->slots_across[0] / t->slots_across[1];
}

static uint64_t send_slots(struct bb_gl_textures *t, const struct bb_gl *gl, const struct bb_atlas *atlas)
{
	const size_t voxels = (size_t)BB_BRICK_STORED * BB_BRICK_STORED * BB_BRICK_STORED;
	uint64_t bytes = 0;
	uint32_t at[3];

	if (t->generation == atlas->generation)
		return 0;
	bind(gl, t, BB_GL_ATLAS);
	for (uint32_t s = 0; s < atlas->n_slots; s++) {
		if (t->seen[s] == atlas->slot_generation[s])
			continue;
		slot_place(t, s, at);
		gl->TexSubImage3D(GL_TEXTURE_3D, 0, (GLint)at[0] * BB_BRICK_STORED, (GLint)at[1] * BB_BRICK_STORED,
				  (GLint)at[2] * BB_BRICK_STORED, BB_BRICK_STORED, BB_BRICK_STORED, BB_BRICK_STORED,
				  GL_RED, GL_UNSIGNED_SHORT, atlas->bricks + s * voxels);
		t->seen[s] = atlas->slot_generation[s];
		bytes += BB_BRICK_BYTES;
	}
	t->generation = atlas->generation;
	return bytes;
}

struct pair { /* the two steps on show */
	uint32_t step[2];
	bool one; /* time falls on the first */
};

static struct pair pair_at(double time, uint32_t n_steps)
{
	const uint32_t first = (uint32_t)time;
	const uint32_t next = first + 1 < n_steps ? first + 1 : first;

	return (struct pair){ { first, next }, time <= first || next == first };
}

/* The flags look ahead to the neighbouring steps: two bricks that show nothing can be seen through half-way. */
static bool invisible(const struct bb_atlas *atlas, const struct pair *p, size_t cell)
{
	const size_t n_cells = cells_of(atlas);

	return atlas->empty[p->step[0] * n_cells + cell] && (p->one || atlas->empty[p->step[1] * n_cells + cell]);
}

static int32_t packed(const struct bb_gl_textures *t, int32_t slot)
{
	uint32_t at[3];

	if (slot < 0)
		return COARSE;
	slot_place(t, (uint32_t)slot, at);
	return (int32_t)(at[0] | at[1] << 8 | at[2] << 16);
}

static uint64_t send_map(struct bb_gl_textures *t, const struct bb_gl *gl, const struct bb_atlas *atlas,
			 const struct pair *p)
{
	const size_t n_cells = cells_of(atlas);
	bool changed = !t->map_valid;

	for (size_t cell = 0; cell < n_cells; cell++) {
		const bool empty = invisible(atlas, p, cell);
		for (size_t k = 0; k < 2; k++) {
			const uint32_t step = p->one ? p->step[0] : p->step[k];
			const int32_t now = empty ? EMPTY : packed(t, atlas->slot[step * n_cells + cell]);
			changed |= t->map[cell * 2 + k] != now;
			t->map[cell * 2 + k] = now;
		}
	}
	if (!changed)
		return 0;
	bind(gl, t, BB_GL_SLOTS);
	gl->TexImage3D(GL_TEXTURE_3D, 0, GL_RG32I, (GLsizei)atlas->grid[0], (GLsizei)atlas->grid[1],
		       (GLsizei)atlas->grid[2], 0, GL_RG_INTEGER, GL_INT, t->map);
	t->map_valid = true;
	return n_cells * 2 * sizeof(*t->map);
}

static uint64_t send_coarse(struct bb_gl_textures *t, const struct bb_gl *gl, const struct bb_atlas *atlas,
			    const struct pair *p)
{
	const uint32_t *dim = atlas->coarse_dim;
	const size_t voxels = (size_t)dim[0] * dim[1] * dim[2];
	uint64_t bytes = 0;

	for (int k = 0; k < 2; k++) {
		const uint32_t step = p->step[k], half = step % 2;
		if (t->coarse_step[half] == step)
			continue;
		bind(gl, t, half ? BB_GL_COARSE_ODD : BB_GL_COARSE_EVEN);
		gl->TexImage3D(GL_TEXTURE_3D, 0, GL_R16, (GLsizei)dim[0], (GLsizei)dim[1], (GLsizei)dim[2], 0, GL_RED,
			       GL_UNSIGNED_SHORT, atlas->coarse + step * voxels);
		t->coarse_step[half] = step;
		bytes += voxels * sizeof(*atlas->coarse);
	}
	return bytes;
}

/* Premultiplied and corrected for the step, so that the shader adds up what it reads. */
static uint64_t send_table(struct bb_gl_textures *t, const struct bb_gl *gl, const struct bb_draw *draw,
			   const struct bb_transfer *tf, struct bb_error *err)
{
	if (t->transfer == tf && t->step_voxels == draw->step_voxels)
		return 0;
	float *table = malloc(BB_GL_TABLE_ENTRIES * 4 * sizeof(*table));
	if (!table) {
		(void)bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "transfer table");
		return 0;
	}
	for (size_t i = 0; i < BB_GL_TABLE_ENTRIES; i++) {
		double rgba[4];
		bb_transfer_at(tf, (double)i / (BB_GL_TABLE_ENTRIES - 1), rgba);
		const double opacity = bb_transfer_opacity_for_step(rgba[3], draw->step_voxels);
		for (size_t c = 0; c < 3; c++)
			table[i * 4 + c] = (float)(rgba[c] * opacity);
		table[i * 4 + 3] = (float)opacity;
	}
	bind(gl, t, BB_GL_TRANSFER);
	gl->TexImage1D(GL_TEXTURE_1D, 0, GL_RGBA32F, BB_GL_TABLE_ENTRIES, 0, GL_RGBA, GL_FLOAT, table);
	free(table);
	t->transfer = tf;
	t->step_voxels = draw->step_voxels;
	return BB_GL_TABLE_ENTRIES * 4 * sizeof(*table);
}

enum bb_status bb_gl_textures_update(struct bb_gl_textures *t, const struct bb_gl *gl, const struct bb_draw *draw,
				     uint64_t *upload_bytes, struct bb_error *err)
{
	const struct bb_atlas *atlas = bb_stream_atlas(draw->stream);
	const struct bb_transfer *tf = bb_stream_config(draw->stream)->transfer;
	const struct pair p = pair_at(draw->step, atlas->n_steps);

	if (t->stream != draw->stream) {
		const enum bb_status st = adopt(t, gl, draw, err);
		if (st != BB_OK)
			return st;
	}
	*upload_bytes += send_slots(t, gl, atlas);
	*upload_bytes += send_map(t, gl, atlas, &p);
	*upload_bytes += send_coarse(t, gl, atlas, &p);
	*upload_bytes += send_table(t, gl, draw, tf, err);
	if (err->number)
		return BB_ERR_NOMEM;
	for (int u = 0; u < BB_GL_UNITS; u++)
		bind(gl, t, (enum bb_gl_unit)u);
	return BB_OK;
}
#endif
