#include "render/gl/copy.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

static const struct format { /* of voxels, by enum bb_brick_type */
	GLint inside;
	GLenum type;
} formats[BB_BRICK_TYPES] = {
	[BB_BRICK_U8] = { GL_R8, GL_UNSIGNED_BYTE },
	[BB_BRICK_U16] = { GL_R16, GL_UNSIGNED_SHORT },
	[BB_BRICK_F16] = { GL_R16F, GL_HALF_FLOAT },
	[BB_BRICK_F32] = { GL_R32F, GL_FLOAT },
};

static GLenum target_of(enum bb_gl_texture which)
{
	return which == BB_GL_TABLE ? GL_TEXTURE_1D : which == BB_GL_TABLES ? GL_TEXTURE_2D : GL_TEXTURE_3D;
}

void bb_gl_copy_init(struct bb_gl_copy *c, const struct bb_gl *gl)
{
	*c = (struct bb_gl_copy){ 0 };
	gl->GenTextures(BB_GL_TEXTURES, c->name);
	gl->ActiveTexture(GL_TEXTURE0);
	for (enum bb_gl_texture t = 0; t < BB_GL_TEXTURES; t++) {
		const GLenum target = target_of(t);
		const GLint filter = t == BB_GL_ATLAS ? GL_LINEAR : GL_NEAREST;
		gl->BindTexture(target, c->name[t]);
		gl->TexParameteri(target, GL_TEXTURE_MIN_FILTER, filter);
		gl->TexParameteri(target, GL_TEXTURE_MAG_FILTER, filter);
		gl->TexParameteri(target, GL_TEXTURE_WRAP_S, t < BB_GL_TABLE ? GL_CLAMP_TO_EDGE : GL_REPEAT);
		gl->TexParameteri(target, GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
		gl->TexParameteri(target, GL_TEXTURE_WRAP_R, GL_CLAMP_TO_EDGE);
		gl->TexParameteri(target, GL_TEXTURE_MAX_LEVEL, 0);
	}
}

void bb_gl_copy_forget(struct bb_gl_copy *c)
{
	c->atlas = NULL;
	c->levels = 0;
}

static void free_maps(struct bb_gl_copy *c)
{
	struct bb_gl_cells *const both[] = { &c->sent, &c->next };

	free(c->seen);
	c->seen = NULL;
	for (int k = 0; k < 2; k++) {
		free(both[k]->place[0]);
		free(both[k]->place[1]);
		free(both[k]->sign);
		*both[k] = (struct bb_gl_cells){ .sign = NULL };
	}
}

void bb_gl_copy_release(struct bb_gl_copy *c, const struct bb_gl *gl)
{
	gl->DeleteTextures(BB_GL_TEXTURES, c->name);
	free_maps(c);
	*c = (struct bb_gl_copy){ 0 };
}

void bb_gl_copy_bind(const struct bb_gl_copy *c, const struct bb_gl *gl, unsigned unit)
{
	for (enum bb_gl_texture t = 0; t < BB_GL_TEXTURES; t++) {
		gl->ActiveTexture(GL_TEXTURE0 + unit + (GLenum)t);
		gl->BindTexture(target_of(t), c->name[t]);
	}
}

static void use(const struct bb_gl_copy *c, const struct bb_gl *gl, enum bb_gl_texture which)
{
	gl->ActiveTexture(GL_TEXTURE0);
	gl->BindTexture(target_of(which), c->name[which]);
}

static enum bb_status no_memory(struct bb_error *err, const char *what)
{
	return bb_fail(err, BB_ERR_NOMEM, 1813, NULL, "%s", what);
}

static size_t cells_of(const struct bb_atlas *atlas)
{
	return (size_t)atlas->grid[0] * atlas->grid[1] * atlas->grid[2];
}

/* ---- another atlas ---- */

static bool allocate_cells(struct bb_gl_cells *cells, size_t n)
{
	for (int k = 0; k < 2; k++)
		cells->place[k] = calloc(n, sizeof(*cells->place[k]));
	cells->sign = calloc(n, sizeof(*cells->sign));
	return cells->place[0] && cells->place[1] && cells->sign;
}

static enum bb_status allocate(struct bb_gl_copy *c, const struct bb_atlas *atlas, struct bb_error *err)
{
	const size_t n = cells_of(atlas);

	free_maps(c);
	c->seen = calloc(atlas->n_slots + (size_t)1, sizeof(*c->seen));
	if (!c->seen || !allocate_cells(&c->sent, n) || !allocate_cells(&c->next, n))
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "maps of %zu bricks", n);
	return BB_OK;
}

static GLenum values_of(enum bb_gl_texture which)
{
	return which == BB_GL_SIGNS ? GL_RGBA_INTEGER : GL_RGBA;
}

static GLenum type_of(enum bb_gl_texture which)
{
	return which == BB_GL_SIGNS ? GL_UNSIGNED_INT : GL_FLOAT;
}

static void make_map(const struct bb_gl_copy *c, const struct bb_gl *gl, enum bb_gl_texture which,
		     const struct bb_atlas *atlas)
{
	use(c, gl, which);
	gl->TexImage3D(GL_TEXTURE_3D, 0, which == BB_GL_SIGNS ? GL_RGBA32UI : GL_RGBA32F, (GLsizei)atlas->grid[0],
		       (GLsizei)atlas->grid[1], (GLsizei)atlas->grid[2], 0, values_of(which), type_of(which), NULL);
}

static enum bb_status adopt(struct bb_gl_copy *c, const struct bb_gl *gl, const struct bb_atlas *atlas,
			    struct bb_error *err)
{
	const struct format *f = &formats[atlas->type];
	GLint most = 0;

	bb_gl_copy_forget(c);
	if (atlas->pad < 1)
		return bb_fail(err, BB_ERR_UNSUPPORTED, 1471, NULL, "bricks of %" PRIu32 " voxels", atlas->edge);
	const enum bb_status st = allocate(c, atlas, err);
	if (st != BB_OK)
		return st;
	gl->GetIntegerv(GL_MAX_3D_TEXTURE_SIZE, &most);
	if (!bb_gl_layout_make(atlas->n_slots, atlas->stored, bb_brick_type_bytes(atlas->type), (uint32_t)most, &c->layout))
		return bb_fail(err, BB_ERR_RANGE, 1805, NULL, "%" PRIu32 " bricks, textures end at %d", atlas->n_slots,
			       most);
	for (int a = 0; a < 3; a++) {
		c->voxels[a] = c->layout.across[a] * atlas->stored;
		c->texel[a] = 1.0 / c->voxels[a];
	}
	use(c, gl, BB_GL_ATLAS);
	gl->TexImage3D(GL_TEXTURE_3D, 0, f->inside, (GLsizei)c->voxels[0], (GLsizei)c->voxels[1], (GLsizei)c->voxels[2], 0,
		       GL_RED, f->type, NULL);
	for (enum bb_gl_texture t = BB_GL_PLACES_A; t <= BB_GL_SIGNS; t++)
		make_map(c, gl, t, atlas);
	if (gl->GetError() != GL_NO_ERROR)
		return no_memory(err, "the bricks' texture");
	c->generation = c->map_generation = UINT64_MAX; /* no generation is that old */
	c->any_sent = false;
	c->n_slots = atlas->n_slots;
	c->stored = atlas->stored;
	c->type = atlas->type;
	memcpy(c->grid, atlas->grid, sizeof(c->grid));
	c->atlas = atlas;
	return BB_OK;
}

/* A streamer whose budget changes has another number of slots at the same address. */
static bool adopted(const struct bb_gl_copy *c, const struct bb_atlas *atlas)
{
	return c->atlas == atlas && c->n_slots == atlas->n_slots && c->stored == atlas->stored && c->type == atlas->type &&
	       !memcmp(c->grid, atlas->grid, sizeof(c->grid));
}

/* ---- bricks ---- */

/* Slots from..from+n-1 lie behind each other in the texture, as they do in memory. */
static bool send_run(const struct bb_gl_copy *c, const struct bb_gl *gl, struct bb_gl_sender *sender, uint32_t from,
		     uint32_t n)
{
	const struct bb_atlas *atlas = c->atlas;
	const GLint stored = (GLint)atlas->stored;
	uint32_t at[3];

	if (!bb_gl_sender_put(sender, gl, atlas->bricks + from * atlas->slot_bytes, n * atlas->slot_bytes))
		return false;
	bb_gl_layout_at(&c->layout, from, at);
	gl->TexSubImage3D(GL_TEXTURE_3D, 0, (GLint)at[0] * stored, (GLint)at[1] * stored, (GLint)at[2] * stored, stored,
			  stored, (GLsizei)n * stored, GL_RED, formats[atlas->type].type, NULL);
	bb_gl_sender_done(gl);
	return true;
}

static bool stale(const struct bb_gl_copy *c, uint32_t slot)
{
	return c->seen[slot] != c->atlas->slot_generation[slot];
}

/* How many from `from` on can go at once. */
static uint32_t run_of(const struct bb_gl_copy *c, uint32_t from)
{
	const uint32_t column_end = from - from % c->layout.across[2] + c->layout.across[2];
	const size_t most = BB_GL_SENDER_BYTES / c->atlas->slot_bytes;
	uint32_t n = 1;

	while (from + n < c->atlas->n_slots && from + n < column_end && n < most && stale(c, from + n))
		n++;
	return n;
}

static enum bb_status send_slots(struct bb_gl_copy *c, const struct bb_gl *gl, struct bb_gl_sender *sender,
				 uint64_t *bytes, struct bb_error *err)
{
	const struct bb_atlas *atlas = c->atlas;

	if (c->generation == atlas->generation)
		return BB_OK;
	use(c, gl, BB_GL_ATLAS);
	for (uint32_t s = 0, n; s < atlas->n_slots; s += n) {
		n = 1;
		if (!stale(c, s))
			continue;
		n = run_of(c, s);
		if (!send_run(c, gl, sender, s, n))
			return no_memory(err, "bricks");
		memcpy(c->seen + s, atlas->slot_generation + s, n * sizeof(*c->seen));
		*bytes += n * atlas->slot_bytes;
	}
	c->generation = atlas->generation;
	c->map_generation = UINT64_MAX; /* what can be seen of them may have changed, too */
	return BB_OK;
}

/* ---- the map ---- */

/* One of the map's textures, if it differs from what has gone. */
static enum bb_status send_cells(const struct bb_gl_copy *c, const struct bb_gl *gl, struct bb_gl_sender *sender,
				 enum bb_gl_texture which, const void *next, const void *sent, size_t cell_bytes,
				 uint64_t *bytes, struct bb_error *err)
{
	const struct bb_atlas *atlas = c->atlas;
	const size_t n_bytes = cells_of(atlas) * cell_bytes;

	if (c->any_sent && !memcmp(next, sent, n_bytes))
		return BB_OK;
	use(c, gl, which);
	if (!bb_gl_sender_put(sender, gl, next, n_bytes))
		return no_memory(err, "the map");
	gl->TexSubImage3D(GL_TEXTURE_3D, 0, 0, 0, 0, (GLsizei)atlas->grid[0], (GLsizei)atlas->grid[1],
			  (GLsizei)atlas->grid[2], values_of(which), type_of(which), NULL);
	bb_gl_sender_done(gl);
	*bytes += n_bytes;
	return BB_OK;
}

static enum bb_status send_map(struct bb_gl_copy *c, const struct bb_gl *gl, struct bb_gl_sender *sender,
			       uint64_t *bytes, struct bb_error *err)
{
	const struct bb_atlas *atlas = c->atlas;
	const struct bb_gl_cells sent = c->sent;
	struct bb_gl_cells next = c->next;
	enum bb_status st = BB_OK;

	if (c->map_generation == atlas->map_generation && c->n_shown == atlas->n_shown)
		return BB_OK;
	bb_gl_cells_fill(atlas, &c->layout, c->texel, &c->sight, &next);
	for (int k = 0; k < 2 && st == BB_OK; k++)
		st = send_cells(c, gl, sender, k ? BB_GL_PLACES_B : BB_GL_PLACES_A, next.place[k], sent.place[k],
				sizeof(*next.place[k]), bytes, err);
	if (st == BB_OK)
		st = send_cells(c, gl, sender, BB_GL_SIGNS, next.sign, sent.sign, sizeof(*next.sign), bytes, err);
	if (st != BB_OK)
		return st;
	c->next = sent;
	c->sent = next;
	c->any_sent = true;
	c->map_generation = atlas->map_generation;
	c->n_shown = atlas->n_shown;
	return BB_OK;
}

/* ---- the transfer function ---- */

static bool same_transfer(const struct bb_transfer *a, const struct bb_transfer *b)
{
	return a->n == b->n && !memcmp(a->point, b->point, a->n * sizeof(a->point[0]));
}

/* Premultiplied and corrected for the step, so that the shader adds up what it reads. */
static void fill_row(const struct bb_transfer *tf, double step_voxels, float (*row)[4])
{
	for (size_t i = 0; i < BB_GL_TABLE_ENTRIES; i++) {
		double rgba[4];
		bb_transfer_at(tf, (double)i / (BB_GL_TABLE_ENTRIES - 1), rgba);
		const double opacity = bb_transfer_opacity_for_step(rgba[3], step_voxels);
		for (size_t k = 0; k < 3; k++)
			row[i][k] = (float)(rgba[k] * opacity);
		row[i][3] = (float)opacity;
	}
}

/* Levels above the leaves that an atlas can have, and the leaves. */
static uint32_t levels_of(const struct bb_atlas *atlas)
{
	uint32_t most = 0, n = 1;

	for (int a = 0; a < 3; a++)
		most = atlas->grid[a] > most ? atlas->grid[a] : most;
	while (most > 1) {
		most = (most + 1) / 2;
		n++;
	}
	return n;
}

static enum bb_status send_table(struct bb_gl_copy *c, const struct bb_gl *gl, const struct bb_transfer *tf,
				 double step_voxels, uint32_t levels, uint64_t *bytes, struct bb_error *err)
{
	if (c->levels >= levels && c->step_voxels == step_voxels && same_transfer(&c->transfer, tf))
		return BB_OK;
	float(*table)[4] = malloc((size_t)levels * BB_GL_TABLE_ENTRIES * sizeof(*table));
	if (!table)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "transfer table");
	for (uint32_t up = 0; up < levels; up++)
		fill_row(tf, step_voxels * (double)(UINT32_C(1) << up), table + (size_t)up * BB_GL_TABLE_ENTRIES);
	use(c, gl, BB_GL_TABLE);
	gl->TexImage1D(GL_TEXTURE_1D, 0, GL_RGBA32F, BB_GL_TABLE_ENTRIES, 0, GL_RGBA, GL_FLOAT, table);
	use(c, gl, BB_GL_TABLES); /* a single row, too: a volume of one cell may be drawn by level */
	gl->TexImage2D(GL_TEXTURE_2D, 0, GL_RGBA32F, BB_GL_TABLE_ENTRIES, (GLsizei)levels, 0, GL_RGBA, GL_FLOAT, table);
	free(table);
	if (!c->levels || !same_transfer(&c->transfer, tf)) {
		bb_gl_sight_make(tf, &c->sight);
		c->map_generation = UINT64_MAX;
	}
	c->transfer = *tf;
	c->step_voxels = step_voxels;
	c->levels = levels;
	*bytes += (uint64_t)levels * BB_GL_TABLE_ENTRIES * sizeof(*table);
	return BB_OK;
}

enum bb_status bb_gl_copy_update(struct bb_gl_copy *c, const struct bb_gl *gl, struct bb_gl_sender *sender,
				 const struct bb_layer *layer, const struct bb_draw *draw, uint64_t *upload_bytes,
				 struct bb_error *err)
{
	enum bb_status st = BB_OK;

	if (!adopted(c, layer->atlas))
		st = adopt(c, gl, layer->atlas, err);
	if (st == BB_OK)
		st = send_table(c, gl, layer->transfer, draw->step_voxels,
				draw->steps_by_level ? levels_of(layer->atlas) : 1, upload_bytes, err);
	if (st == BB_OK)
		st = send_slots(c, gl, sender, upload_bytes, err);
	return st == BB_OK ? send_map(c, gl, sender, upload_bytes, err) : st;
}
