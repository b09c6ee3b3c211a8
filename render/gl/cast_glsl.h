/*
 * render/gl/cast_glsl.h: the ray caster as GLSL 3.30 core. Read by cast.c only; repeats rays.c in float.
 *
 * A ray is walked brick by brick and inside a brick sample by sample, always at whole sample numbers: what a brick is
 * (empty, resident, coarse) can change which texture is read but never where. What differs from brick to brick is in
 * loops and not in branches, because llvmpipe runs both sides of a branch but skips a loop that no pixel of a group
 * wants; the mixed loop serves pairs of steps of which one brick is there and one is not.
 */
#ifndef BB_RENDER_GL_CAST_GLSL_H
#define BB_RENDER_GL_CAST_GLSL_H

static const char bb_cast_vertex_glsl[] =
	"#version 330 core\n"
	"void main()\n" /* one triangle over the whole picture */
	"{\n"
	"	gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0);\n"
	"}\n";

/* "#version 330 core\n#define STEPS n\n" goes before it: 1 when the time falls on a step, else 2. */
static const char bb_cast_fragment_glsl[] =
	"uniform vec2 u_pixel;\n"                        /* 1 / picture size */
	"uniform vec3 u_corner, u_across, u_down;\n"     /* m, from the eye */
	"uniform vec3 u_eye, u_voxels_per_m, u_dim;\n"   /* the eye in voxels */
	"uniform float u_step_m, u_mix;\n"
	"uniform vec3 u_grid, u_texel, u_coarse_scale, u_coarse_offset;\n"
	"uniform vec2 u_table;\n"                        /* value to table coordinate: scale, offset */
	"uniform isampler3D u_slots;\n"
	"uniform sampler3D u_atlas, u_coarse_0, u_coarse_1;\n"
	"uniform sampler1D u_transfer;\n"
	"out vec4 o_colour;\n"
	"\n"
	"const float EDGE = 16.0, STORED = 18.0, OPAQUE = 1e-4;\n"
	"\n"
	/* From voxel coordinates to the atlas for the brick at `brick` in slot s: add this, times u_texel. */
	"vec3 slot_offset(int s, vec3 brick)\n"
	"{\n"
	"	vec3 slot = vec3(float(s & 255), float((s >> 8) & 255), float((s >> 16) & 255));\n"
	"	return slot * STORED - brick * EDGE + 1.5;\n"
	"}\n"
	"\n"
	"#define FINE(offset) texture(u_atlas, (at + offset) * u_texel).x\n"
	"#define COARSE(volume) texture(volume, at * u_coarse_scale + u_coarse_offset).x\n"
	"#if STEPS == 2\n"
	"#define VALUE(v0, v1) mix(v0, v1, u_mix)\n"
	"#else\n"
	"#define VALUE(v0, v1) (v0)\n"
	"#endif\n"
	/* One line: GLSL 3.30 does not have continued lines. */
	"#define WALK(to, v0, v1) for (; i < to; i++) { "
	"vec3 at = clamp(first + float(i) * stride, low, high); "
	"float v = VALUE(v0, v1); "
	"sum += (1.0 - sum.w) * texture(u_transfer, v * u_table.x + u_table.y); }\n"
	"\n"
	"void main()\n"
	"{\n"
	"	vec2 share = gl_FragCoord.xy * u_pixel;\n" /* row 0 of the framebuffer is the picture's top row */
	"	vec3 d = normalize(u_corner + share.x * u_across + share.y * u_down) * u_voxels_per_m;\n"
	"	d = mix(d, vec3(1e-9), lessThan(abs(d), vec3(1e-9)));\n"
	"	vec3 a = (-0.5 - u_eye) / d, b = (u_dim - 0.5 - u_eye) / d;\n"
	"	vec3 near = min(a, b), far = max(a, b);\n"
	"	float enter = max(max(near.x, near.y), max(near.z, 0.0));\n"
	"	float leave = min(min(far.x, far.y), far.z);\n"
	"	int n = leave > enter ? int(ceil((leave - enter) / u_step_m - 0.5)) : 0;\n"
	"	vec3 first = u_eye + d * (enter + 0.5 * u_step_m), stride = d * u_step_m;\n"
	"	vec3 ahead = vec3(greaterThan(stride, vec3(0.0))), per_stride = 1.0 / stride;\n"
	"	vec4 sum = vec4(0.0);\n"
	"\n"
	"	for (int i = 0; i < n;) {\n"
	"		vec3 here = clamp(first + float(i) * stride, vec3(0.0), u_dim - 1.0);\n"
	"		vec3 brick = min(floor(here / EDGE), u_grid - 1.0);\n"
	"		ivec2 s = texelFetch(u_slots, ivec3(brick), 0).xy;\n"
	"		vec3 low = brick * EDGE, high = min(low + EDGE, u_dim - 1.0);\n"
	/* The outermost bricks reach out to the box's own sides, half a voxel further. */
	"		vec3 outer = vec3(lessThan(brick, vec3(0.5))) * (ahead - 1.0) +\n"
	"		             vec3(greaterThan(brick, u_grid - 1.5)) * ahead;\n"
	"		vec3 last = ((brick + ahead + outer) * EDGE - first) * per_stride;\n"
	"		int end = min(n, max(i + 1, int(ceil(min(min(last.x, last.y), last.z)))));\n"
	"		bool empty = s.x == -2, fine = min(s.x, s.y) >= 0, coarse = max(s.x, s.y) == -1;\n"
	"		int fine_end = fine ? end : i, coarse_end = coarse ? end : i, mixed_end = empty ? i : end;\n"
	"		vec3 offset_0 = slot_offset(s.x, brick), offset_1 = slot_offset(s.y, brick);\n"
	"\n"
	"		WALK(fine_end, FINE(offset_0), FINE(offset_1))\n"
	"		WALK(coarse_end, COARSE(u_coarse_0), COARSE(u_coarse_1))\n"
	"		WALK(mixed_end, s.x >= 0 ? FINE(offset_0) : COARSE(u_coarse_0), "
	"s.y >= 0 ? FINE(offset_1) : COARSE(u_coarse_1))\n"
	"		i = sum.w > 1.0 - OPAQUE ? n : max(i, end);\n"
	"	}\n"
	"	o_colour = floor(clamp(sum, 0.0, 1.0) * 255.0 + 0.5) / 255.0;\n"
	"}\n";

#endif
