/*
 * render/gl/cast_glsl.h: the ray caster as GLSL 3.30 core, in pieces that program.c puts together for a number of layers
 * and what they are. Read by program.c only; repeats rays.c in float.
 *
 * "@" in a piece stands for the layer's number. A ray asks the map where it is, walks to the end of what is alike there
 * and asks again; samples always lie at whole numbers of steps, so that what a brick is can change what is read but never
 * where. llvmpipe runs both sides of a branch, and a loop at least once: loops are few, and test at their end. What such
 * a loop computes afresh in each round goes on being computed for a pixel that has left it while others of its group have
 * not: after the loop it must not matter, or come out the same once more.
 */
#ifndef BB_RENDER_GL_CAST_GLSL_H
#define BB_RENDER_GL_CAST_GLSL_H

static const char bb_cast_vertex_glsl[] =
	"#version 330 core\n"
	"void main()\n" /* one triangle over the whole picture */
	"{\n"
	"	gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0);\n"
	"}\n";

/* Before it: "#version 330 core" and #defines: TABLE (entries), BY_LEVEL, LAYERS, MESHES (0 or 1), TAKES (samples that one
 * look at the map serves), FRAGMENTS (most of a pixel), TILE (pixels); of cells.h: SEEN, PARTLY, FLAT. */
static const char bb_cast_common_glsl[] =
	"uniform vec2 u_pixel;\n" /* 1 / picture size */
	"out vec4 o_colour;\n"
	"\n"
	"const float OPAQUE = 1e-4, FAR = 1e30;\n"
	"#define ALONE (LAYERS == 1 && !MESHES)\n"
	"vec4 sum = vec4(0.0);\n"
	"\n"
	"float two_to(uint k) { return uintBitsToFloat((127u + k) << 23u); }\n"
	"\n"
	/* The built-in one may be off by 1e-4. A polynomial through Chebyshev's points, good to 2e-8. */
	"float angle(float y, float x)\n" /* -pi..pi */
	"{\n"
	"	float a = abs(x), b = abs(y), t = min(a, b) / max(max(a, b), 1e-30), z = t * t;\n"
	"	float p = ((((((((0.0028340643 * z - 0.0160050305) * z + 0.0425876075) * z - 0.0749544544) * z\n"
	"		+ 0.106367541) * z - 0.142025705) * z + 0.199924836) * z - 0.333330668) * z + 0.999999984) * t;\n"
	"	p = b > a ? 1.57079633 - p : p;\n"
	"	p = x < 0.0 ? 3.14159265 - p : p;\n"
	"	return y < 0.0 ? -p : p;\n"
	"}\n";

/* Before it: #defines STEPS@ (1 when the time falls on a step, else 2), SPHERICAL@, FLATS@ (some cells have one value). */
static const char bb_cast_layer_glsl[] =
	"uniform vec3 u_corner@, u_across@, u_down@;\n" /* m, from the eye */
	"uniform vec3 u_eye@, u_voxels_per_m@, u_dim@;\n" /* the eye in corner coordinates */
	"uniform float u_step_m@, u_mix@, u_per_row@;\n" /* the last: 1 / rows of the table */
	"uniform vec3 u_grid@, u_texel@, u_per_cells@;\n" /* cells; 1 / voxels of the texture, of all cells */
	"uniform vec2 u_brick@;\n" /* edge; parts of a cell along an edge */
	"#if SPHERICAL@\n"
	"uniform vec3 u_from@, u_per@, u_size@;\n" /* of the grid: r, theta, phi; 1 / voxel; voxels */
	"#endif\n"
	"uniform usampler3D u_signs@;\n"
	"uniform sampler3D u_places_a@, u_places_b@, u_atlas@;\n"
	"#if BY_LEVEL\n"
	"uniform sampler2D u_table@;\n"
	"#define ENTRY@(v) vec2(v * ((TABLE - 1.0) / TABLE) + 0.5 / TABLE, row@)\n"
	"#else\n"
	"uniform sampler1D u_table@;\n"
	"#define ENTRY@(v) (v * ((TABLE - 1.0) / TABLE) + 0.5 / TABLE)\n"
	"#endif\n"
	"\n"
	"vec3 first@, stride@, inverse@, behind@, ahead@;\n"
	"float enter@, i@, n@, end@, every@;\n" /* the next sample, how many, where to ask again, how many at once */
	"float row@;\n" /* of the table */
	"\n"
	"void begin@(vec2 share)\n"
	"{\n"
	"	vec3 d = normalize(u_corner@ + share.x * u_across@ + share.y * u_down@) * u_voxels_per_m@;\n"
	"	d = mix(d, vec3(1e-9), lessThan(abs(d), vec3(1e-9)));\n"
	"	vec3 a = -u_eye@ / d, b = (u_dim@ - u_eye@) / d;\n"
	"	vec3 near = min(a, b), far = max(a, b);\n"
	"	float leave = min(min(far.x, far.y), far.z);\n"
	"	enter@ = max(max(near.x, near.y), max(near.z, 0.0));\n"
	"	first@ = u_eye@ + d * (enter@ + 0.5 * u_step_m@);\n"
	"	stride@ = d * u_step_m@;\n"
	"	inverse@ = 1.0 / stride@;\n"
	"	behind@ = first@ * inverse@;\n"
	"	ahead@ = max(inverse@, vec3(0.0));\n" /* to a cell's far side: from its lower one when that is it */
	"	n@ = leave > enter@ ? ceil((leave - enter@) / u_step_m@ - 0.5) : 0.0;\n"
	"	i@ = end@ = 0.0;\n"
	"	every@ = 1.0;\n"
	"	row@ = 0.0;\n"
	"#if SPHERICAL@\n" /* what lies outside the ball shows nothing; a sample more on either side does no harm */
	"	vec3 o = first@ - 0.5 * u_dim@;\n"
	"	float radius = 0.5 * u_dim@.x, q = dot(stride@, stride@), h = dot(o, stride@) / q;\n"
	"	float root = h * h - (dot(o, o) - radius * radius) / q;\n"
	"	i@ = end@ = max(0.0, floor(-h - sqrt(max(root, 0.0))));\n"
	"	n@ = root < 0.0 ? 0.0 : min(n@, ceil(-h + sqrt(max(root, 0.0))) + 1.0);\n"
	"#endif\n"
	"}\n"
	"\n"
	"vec4 shade@(float v) { return texture(u_table@, ENTRY@(v)); }\n"
	"\n"
	/* m samples of one value. The logarithm of what is left: its built-in loses what little a thin mist takes. */
	"vec4 shade@(float v, float m)\n"
	"{\n"
	"	vec4 c = shade@(v);\n"
	"	float a = c.w, series = -a * (1.0 + a * (0.5 + a * (0.33333333 + a * (0.25 + a * 0.2))));\n"
	"	float through = exp(m * (a < 0.1 ? series : log(max(1.0 - a, 1e-30))));\n"
	"	return c * ((1.0 - through) / max(a, 1e-20));\n"
	"}\n"
	"\n"
	"#if SPHERICAL@\n"
	"bool grid@(inout vec3 p)\n" /* from the cube to the grid's own coordinates; false: outside */
	"{\n"
	"	p -= 0.5 * u_dim@;\n"
	"	float phi = angle(p.z, p.x);\n"
	"	phi = phi < u_from@.z ? phi + 6.28318531 : phi;\n"
	"	p = (vec3(length(p), angle(length(p.xz), p.y), phi) - u_from@) * u_per@;\n"
	"	return all(greaterThanEqual(p.xy, vec2(0.0))) && all(lessThanEqual(p, u_size@));\n"
	"}\n"
	"#endif\n"
	"\n"
	"vec3 at_a@, by_a@, at_b@, by_b@;\n" /* in the texture; from one sample to the next */
	"float flat_a@, flat_b@;\n"
	"\n"
	/* Where the sample at `at` lies in the texture, by the cell that `of` lies in. */
	"void place@(vec3 at, vec3 of)\n"
	"{\n"
	"	vec3 cell = of * u_per_cells@;\n"
	"	vec4 a = texture(u_places_a@, cell);\n"
	"	vec3 scale = u_texel@ * a.w;\n"
	"	at_a@ = at * scale + a.xyz;\n"
	"	by_a@ = stride@ * scale;\n"
	"#if FLATS@\n"
	"	flat_a@ = a.w > 0.0 ? -1.0 : a.x;\n"
	"#endif\n"
	"#if STEPS@ == 2\n"
	"	vec4 b = texture(u_places_b@, cell);\n"
	"	scale = u_texel@ * b.w;\n"
	"	at_b@ = at * scale + b.xyz;\n"
	"	by_b@ = stride@ * scale;\n"
	"#if FLATS@\n"
	"	flat_b@ = b.w > 0.0 ? -1.0 : b.x;\n"
	"#endif\n"
	"#endif\n"
	"}\n"
	"\n"
	/* Sample i@ and TAKES - 1 behind it, by the cell of the middle one, or of the last one that is to be taken: up to end@
	 * all bricks are of one level, and each knows half a voxel more than what is its own. */
	"void find@()\n"
	"{\n"
	"#if !SPHERICAL@\n"
	"	vec3 at = first@ + i@ * stride@;\n"
	"	place@(at, TAKES > 1 ? first@ + min(i@ + 1.0, end@ - 1.0) * stride@ : at);\n"
	"#endif\n"
	"}\n"
	"\n"
	/* To the next sample that may show something, and how far one may go from there; i@ >= n@: there is none. */
	"void advance@()\n"
	"{\n"
	"	do {\n"
	"		vec3 here = first@ + i@ * stride@;\n"
	"#if SPHERICAL@\n"
	"		bool inside = grid@(here);\n"
	"#endif\n"
	"		vec3 cell = clamp(floor(here * (1.0 / u_brick@.x)), vec3(0.0), u_grid@ - 1.0);\n"
	"		uvec4 sign = texelFetch(u_signs@, ivec3(cell), 0);\n"
	"		bool partly = (sign.x & uint(PARTLY)) != 0u;\n"
	"		float cells = two_to(sign.x & 15u), wide = u_brick@.x * (partly ? 1.0 / u_brick@.y : cells);\n"
	"		vec3 low = floor(cell / cells) * (u_brick@.x * cells);\n"
	"		vec3 part = clamp(floor((here - low) / wide), vec3(0.0), vec3(u_brick@.y - 1.0));\n"
	"		uint bit = uint(part.x + 4.0 * part.y + 16.0 * part.z);\n"
	"		uint bits = (bit < 32u ? sign.z : sign.w) >> (bit & 31u);\n"
	"		bool seen = (sign.x & uint(SEEN)) != 0u && (!partly || (bits & 1u) != 0u);\n"
	"		low += partly ? part * wide : vec3(0.0);\n"
	"#if SPHERICAL@\n"
	"		float stop = min(n@, i@ + 1.0);\n"
	"		seen = seen && inside;\n"
	"#else\n"
	"		vec3 last = low * inverse@ + (wide * ahead@ - behind@);\n"
	"		float stop = min(n@, max(i@ + 1.0, ceil(min(min(last.x, last.y), last.z))));\n"
	"#endif\n"
	"#if BY_LEVEL\n" /* the finer one of two bricks says how often */
	"		uint up = (sign.x >> 4u) & 31u;\n"
	"		row@ = (float(up) + 0.5) * u_per_row@;\n"
	"		every@ = two_to(up);\n"
	"		float half_way = floor(0.5 * every@);\n"
	"		i@ = max(i@, min(stop, ceil((i@ - half_way) / every@) * every@ + half_way));\n"
	"#endif\n"
	"#if SPHERICAL@\n"
	"		place@(here, here);\n"
	"#endif\n"
	"		i@ = seen ? i@ : stop;\n"
	"		end@ = stop;\n"
	"#if ALONE && FLATS@ && !SPHERICAL@\n" /* a cell of one value is not sampled: m samples at once */
	"		float v = texelFetch(u_places_a@, ivec3(cell), 0).x, m = (sign.x & uint(FLAT)) != 0u ? stop - i@ : 0.0;\n"
	"#if STEPS@ == 2\n"
	"		v = mix(v, texelFetch(u_places_b@, ivec3(cell), 0).x, u_mix@);\n"
	"#endif\n"
	"		sum += (1.0 - sum.w) * shade@(clamp(v, 0.0, 1.0), m);\n"
	"		i@ += m;\n"
	"#endif\n"
	"	} while (i@ >= end@ && i@ < n@);\n"
	"}\n"
	"\n"
	/* The sample that was found; goes on to the next of the TAKES. */
	"vec4 taken@()\n"
	"{\n"
	"	float v = texture(u_atlas@, at_a@).x;\n"
	"#if FLATS@\n"
	"	v = flat_a@ < 0.0 ? v : flat_a@;\n"
	"#endif\n"
	"#if TAKES > 1\n"
	"	at_a@ += by_a@;\n"
	"#endif\n"
	"#if STEPS@ == 2\n"
	"	float w = texture(u_atlas@, at_b@).x;\n"
	"#if FLATS@\n"
	"	w = flat_b@ < 0.0 ? w : flat_b@;\n"
	"#endif\n"
	"#if TAKES > 1\n"
	"	at_b@ += by_b@;\n"
	"#endif\n"
	"	v = mix(v, w, u_mix@);\n"
	"#endif\n"
	"	return shade@(v);\n"
	"}\n"
	"\n";

/* Quantised here: how a driver rounds would differ from one to the next. */
#define BB_CAST_END "	o_colour = floor(clamp(sum, 0.0, 1.0) * 255.0 + 0.5) / 255.0;\n}\n"

static const char bb_cast_alone_glsl[] =
	"void main()\n"
	"{\n"
	"	begin0(gl_FragCoord.xy * u_pixel);\n" /* row 0 of the framebuffer is the picture's top row */
	"	while (i0 < n0) {\n"
	"		advance0();\n"
	"		do {\n"
	"			find0();\n"
	"			sum += (i0 < end0 ? 1.0 - sum.w : 0.0) * taken0();\n"
	"#if TAKES > 1\n"
	"			sum += (i0 + 1.0 < end0 ? 1.0 - sum.w : 0.0) * taken0();\n"
	"			sum += (i0 + 2.0 < end0 ? 1.0 - sum.w : 0.0) * taken0();\n"
	"#endif\n"
	"#if BY_LEVEL\n"
	"			i0 = min(i0 + every0, end0);\n"
	"#else\n"
	"			i0 = min(i0 + float(TAKES), end0);\n"
	"#endif\n"
	"		} while (i0 < end0);\n"
	"		i0 = sum.w > 1.0 - OPAQUE ? n0 : i0;\n"
	"	}\n"
	BB_CAST_END;

/* ---- several volumes, and meshes: the A-buffer ---- */

/* What the pixel's ray meets of the triangles of its tile, sorted by the distance from the eye, and those that are as far
 * in their own order. */
static const char bb_cast_meshes_glsl[] =
	"uniform vec3 u_room_corner, u_room_across, u_room_down;\n"
	"uniform samplerBuffer u_planes, u_colours;\n"
	"uniform usamplerBuffer u_tiles;\n"
	"uniform int u_tiles_across;\n"
	"float far_m[FRAGMENTS];\n"
	"int which[FRAGMENTS];\n"
	"vec3 direction;\n"
	"\n"
	"vec4 plane(int triangle, int k) { return texelFetch(u_planes, triangle * 3 + k); }\n"
	"\n"
	/* A ray through an edge is on the side on which one a little to its right is, then one a little below. */
	"bool within(vec3 normal)\n"
	"{\n"
	"	float w = dot(direction, normal), right = dot(u_room_across, normal), below = dot(u_room_down, normal);\n"
	"	return (w != 0.0 ? w : right != 0.0 ? right : below) > 0.0;\n"
	"}\n"
	"\n"
	"int collect(vec2 share)\n"
	"{\n"
	"	ivec2 tile = ivec2(gl_FragCoord.xy) / TILE;\n"
	"	int at = tile.y * u_tiles_across + tile.x, n = 0;\n"
	"	int end = int(texelFetch(u_tiles, at + 1).x);\n"
	"	direction = normalize(u_room_corner + share.x * u_room_across + share.y * u_room_down);\n"
	"	for (int k = int(texelFetch(u_tiles, at).x); k < end; k++) {\n"
	"		int triangle = int(texelFetch(u_tiles, k).x);\n"
	"		vec4 a = plane(triangle, 0), b = plane(triangle, 1), c = plane(triangle, 2);\n"
	"		float m = a.w / dot(direction, a.xyz + b.xyz + c.xyz);\n"
	"		if (!within(a.xyz) || !within(b.xyz) || !within(c.xyz) || (n == FRAGMENTS && m >= far_m[FRAGMENTS - 1]))\n"
	"			continue;\n"
	"		int j = min(n, FRAGMENTS - 1);\n"
	"		n = j + 1;\n"
	"		for (; j > 0 && far_m[j - 1] > m; j--) {\n"
	"			far_m[j] = far_m[j - 1];\n"
	"			which[j] = which[j - 1];\n"
	"		}\n"
	"		far_m[j] = m;\n"
	"		which[j] = triangle;\n"
	"	}\n"
	"	return n;\n"
	"}\n"
	"\n"
	"vec4 surface(int triangle)\n"
	"{\n"
	"	vec4 a = plane(triangle, 0), b = plane(triangle, 1), c = plane(triangle, 2);\n"
	"	vec3 w = vec3(dot(direction, a.xyz), dot(direction, b.xyz), dot(direction, c.xyz));\n"
	"	int corner = int(b.w) * 3;\n"
	"	vec4 rgba = w.x * texelFetch(u_colours, corner) + w.y * texelFetch(u_colours, corner + 1) +\n"
	"		w.z * texelFetch(u_colours, corner + 2);\n"
	"	rgba = clamp(rgba / (w.x + w.y + w.z), 0.0, 1.0);\n"
	"	return vec4(rgba.xyz * rgba.w, rgba.w);\n"
	"}\n"
	"\n";

/* For each layer, behind the layers' own pieces. "next" is the distance of its next sample, "beyond" that of the first
 * sample that one must ask the map for. */
static const char bb_cast_turn_glsl[] =
	"float next@, beyond@;\n"
	"float distance@(float i) { return i < n@ ? enter@ + (i + 0.5) * u_step_m@ : FAR; }\n"
	"void ready@()\n"
	"{\n"
	"	if (i@ >= end@ && i@ < n@)\n"
	"		advance@();\n"
	"	next@ = distance@(i@);\n"
	"	beyond@ = i@ < n@ ? enter@ + (end@ + 0.5) * u_step_m@ : FAR;\n"
	"}\n"
	"void turn@(float nearest, float until)\n"
	"{\n"
	"	bool go = next@ == nearest && next@ < until;\n"
	"	find@();\n"
	"	sum += (go ? 1.0 - sum.w : 0.0) * taken@();\n"
	"	i@ = go ? min(i@ + every@, end@) : i@;\n"
	"	next@ = distance@(i@);\n"
	"}\n"
	"\n";

/* Between them, once for each layer: bb_cast_begin_glsl, bb_cast_ready_glsl, bb_cast_turns_glsl. NEAREST and BEYOND are
 * the least of all layers' next and beyond. */
static const char bb_cast_merge_glsl[] =
	"void main()\n"
	"{\n"
	"	vec2 share = gl_FragCoord.xy * u_pixel;\n"
	"	float surface_m = FAR;\n"
	"#if MESHES\n"
	"	int n_surfaces = collect(share), surfaces = 0;\n"
	"	surface_m = n_surfaces > 0 ? far_m[0] : FAR;\n"
	"#endif\n";
static const char bb_cast_begin_glsl[] = "	begin@(share);\n";
static const char bb_cast_rounds_glsl[] =
	"	bool more = true;\n"
	"	while (more) {\n";
static const char bb_cast_ready_glsl[] = "		ready@();\n";
static const char bb_cast_samples_glsl[] =
	"		float until = BEYOND;\n"
	"		do {\n";
/* At equal distances volumes come before surfaces: a sample as far as the surface is still taken. */
static const char bb_cast_turns_glsl[] = "			turn@(NEAREST, next@ <= surface_m ? until : 0.0);\n";
static const char bb_cast_surfaces_glsl[] =
	"		} while (NEAREST < until && NEAREST <= surface_m && sum.w <= 1.0 - OPAQUE);\n"
	"#if MESHES\n"
	"		if (surface_m < min(NEAREST, until)) {\n"
	"			sum += (1.0 - sum.w) * surface(which[surfaces]);\n"
	"			surfaces++;\n"
	"			surface_m = surfaces < n_surfaces ? far_m[surfaces] : FAR;\n"
	"		}\n"
	"#endif\n"
	"		more = sum.w <= 1.0 - OPAQUE && min(NEAREST, surface_m) < FAR;\n"
	"	}\n"
	BB_CAST_END;

#endif
