/*
 * render/gl/cast_glsl.h: the ray caster as GLSL 3.30 core, in pieces that program.c puts together for a number of layers
 * and what they are. Read by program.c only; repeats rays.c in float.
 *
 * "@" in a piece stands for the layer's number. A ray asks the map where it is, walks to the end of what is alike there
 * and asks again; samples always lie at whole numbers of steps, so that what a brick is can change which texture is read
 * but never where. What only some pixels of a group want is in a loop and not in a branch, because llvmpipe runs both
 * sides of a branch but skips a loop that no pixel of a group wants.
 */
#ifndef BB_RENDER_GL_CAST_GLSL_H
#define BB_RENDER_GL_CAST_GLSL_H

static const char bb_cast_vertex_glsl[] =
	"#version 330 core\n"
	"void main()\n" /* one triangle over the whole picture */
	"{\n"
	"	gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0);\n"
	"}\n";

/* Before it: "#version 330 core" and #defines: TABLE (entries), BY_LEVEL, LAYERS, MESHES (0 or 1). */
static const char bb_cast_common_glsl[] =
	"uniform vec2 u_pixel;\n" /* 1 / picture size */
	"out vec4 o_colour;\n"
	"\n"
	"const float OPAQUE = 1e-4, FAR = 1e30;\n"
	"#define ALONE (LAYERS == 1 && !MESHES)\n"
	"vec4 sum = vec4(0.0);\n"
	"\n"
	"float two_to(uint k, float sign) { return uintBitsToFloat(uint(127 + int(sign) * int(k)) << 23u); }\n"
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
	"}\n"
	"\n"
	/* Word of a cell (see cells.h): position p of the volume is p * shrink + the result in the texture; flat: the
	 * value, or -1. */
	"vec3 place(uint word, vec3 cell, vec4 brick, vec3 texel, out float shrink, out float flat_value)\n"
	"{\n"
	"	vec3 slot = vec3((word >> 9u) & 15u, (word >> 13u) & 511u, (word >> 22u) & 511u);\n"
	"	bool is_flat = word >= 0x80000000u;\n"
	"	shrink = two_to((word >> 4u) & 31u, -1.0);\n"
	"	flat_value = is_flat ? uintBitsToFloat(word & 0x7FFFFFF0u) : -1.0;\n"
	"	vec3 from = (slot * brick.y - floor(cell * shrink) * brick.x + brick.z) * texel;\n"
	"	shrink = is_flat ? 0.0 : shrink;\n"
	"	return is_flat ? vec3(0.0) : from;\n"
	"}\n";

/* Before it: #defines STEPS@ (1 when the time falls on a step, else 2) and SPHERICAL@. */
static const char bb_cast_layer_glsl[] =
	"uniform vec3 u_corner@, u_across@, u_down@;\n" /* m, from the eye */
	"uniform vec3 u_eye@, u_voxels_per_m@, u_dim@;\n" /* the eye in corner coordinates */
	"uniform float u_step_m@, u_mix@;\n"
	"uniform vec3 u_grid@, u_texel@;\n"
	"uniform vec4 u_brick@;\n" /* edge, stored, pad, parts of a cell along an edge */
	"#if SPHERICAL@\n"
	"uniform vec3 u_from@, u_per@, u_size@;\n" /* of the grid: r, theta, phi; 1 / voxel; voxels */
	"#endif\n"
	"uniform usampler3D u_map@;\n"
	"uniform sampler3D u_atlas@;\n"
	"uniform sampler2D u_table@;\n"
	"\n"
	"vec3 first@, stride@, inverse@, ahead@;\n"
	"float enter@, i@, n@, end@, every@;\n" /* the next sample, how many, where to ask again, how many at once */
	"int row@;\n"
	"vec3 at_a@, by_a@, at_b@, by_b@;\n"    /* sample i in the texture: at + i * by */
	"float flat_a@, flat_b@;\n"
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
	"	ahead@ = vec3(greaterThan(stride@, vec3(0.0)));\n"
	"	n@ = leave > enter@ ? ceil((leave - enter@) / u_step_m@ - 0.5) : 0.0;\n"
	"	i@ = end@ = 0.0;\n"
	"	every@ = 1.0;\n"
	"	row@ = 0;\n"
	"#if SPHERICAL@\n" /* what lies outside the ball shows nothing; a sample more on either side does no harm */
	"	vec3 o = first@ - 0.5 * u_dim@;\n"
	"	float radius = 0.5 * u_dim@.x, q = dot(stride@, stride@), h = dot(o, stride@) / q;\n"
	"	float root = h * h - (dot(o, o) - radius * radius) / q;\n"
	"	i@ = end@ = max(0.0, floor(-h - sqrt(max(root, 0.0))));\n"
	"	n@ = root < 0.0 ? 0.0 : min(n@, ceil(-h + sqrt(max(root, 0.0))) + 1.0);\n"
	"#endif\n"
	"}\n"
	"\n"
	"vec4 shade@(float v) { return texelFetch(u_table@, ivec2(int(v * float(TABLE - 1) + 0.5), row@), 0); }\n"
	"\n"
	/* To the next sample that may show something, and the cell it lies in; i@ >= n@: there is none. */
	"void advance@()\n"
	"{\n"
	"	while (i@ >= end@ && i@ < n@) {\n"
	"		vec3 here = first@ + i@ * stride@;\n"
	"		bool inside = true;\n"
	"#if SPHERICAL@\n"
	"		vec3 p = here - 0.5 * u_dim@;\n"
	"		float phi = angle(p.z, p.x);\n"
	"		here = (vec3(length(p), angle(length(p.xz), p.y), phi < u_from@.z ? phi + 6.28318531 : phi)\n"
	"			- u_from@) * u_per@;\n"
	"		inside = all(greaterThanEqual(here, vec3(0.0))) && all(lessThanEqual(here, u_size@));\n"
	"#endif\n"
	"		vec3 cell = clamp(floor(here / u_brick@.x), vec3(0.0), u_grid@ - 1.0);\n"
	"		uvec4 e = texelFetch(u_map@, ivec3(cell), 0);\n"
	"		uint alike = e.x & 15u;\n"
	"		bool partly = alike == 15u;\n"
	"		float wide = u_brick@.x * (partly ? 1.0 / u_brick@.w : two_to(alike, 1.0));\n"
	"		vec3 part = clamp(floor((here - cell * u_brick@.x) / wide), vec3(0.0), vec3(u_brick@.w - 1.0));\n"
	"		uint bit = partly ? uint(part.x + 4.0 * part.y + 16.0 * part.z) : 0u;\n"
	"		bool visible = inside && (((bit < 32u ? e.z : e.w) >> (bit & 31u)) & 1u) != 0u;\n"
	"#if SPHERICAL@\n"
	"		float stop = i@ + 1.0;\n"
	"#else\n"
	"		vec3 low = partly ? cell * u_brick@.x + part * wide : floor(cell * two_to(alike, -1.0)) * wide;\n"
	"		vec3 last = (low + ahead@ * wide - first@) * inverse@;\n"
	"		float stop = min(n@, max(i@ + 1.0, ceil(min(min(last.x, last.y), last.z))));\n"
	"#endif\n"
	"		float shrink_a, shrink_b;\n"
	"		vec3 from_a = place(e.x, cell, u_brick@, u_texel@, shrink_a, flat_a@);\n"
	"#if STEPS@ == 2\n"
	"		vec3 from_b = place(e.y, cell, u_brick@, u_texel@, shrink_b, flat_b@);\n"
	"#endif\n"
	"#if SPHERICAL@\n"
	"		at_a@ = here * shrink_a * u_texel@ + from_a;\n"
	"		by_a@ = vec3(0.0);\n"
	"#if STEPS@ == 2\n"
	"		at_b@ = here * shrink_b * u_texel@ + from_b;\n"
	"		by_b@ = vec3(0.0);\n"
	"#endif\n"
	"#else\n"
	"		at_a@ = first@ * shrink_a * u_texel@ + from_a;\n"
	"		by_a@ = stride@ * shrink_a * u_texel@;\n"
	"#if STEPS@ == 2\n"
	"		at_b@ = first@ * shrink_b * u_texel@ + from_b;\n"
	"		by_b@ = stride@ * shrink_b * u_texel@;\n"
	"#endif\n"
	"#endif\n"
	"#if BY_LEVEL\n" /* the finer one of two bricks says how often */
	"		uint up = flat_a@ >= 0.0 ? 0u : (e.x >> 4u) & 31u;\n"
	"#if STEPS@ == 2\n"
	"		up = min(up, flat_b@ >= 0.0 ? 0u : (e.y >> 4u) & 31u);\n"
	"#endif\n"
	"		every@ = two_to(up, 1.0);\n"
	"		row@ = int(up);\n"
	"		float half_way = floor(0.5 * every@);\n"
	"		i@ = max(i@, min(stop, ceil((i@ - half_way) / every@) * every@ + half_way));\n"
	"#endif\n"
	"		i@ = visible ? i@ : stop;\n"
	"		end@ = stop;\n"
	"#if ALONE\n" /* a cell of one value: no sampling */
	"		bool is_flat = flat_a@ >= 0.0;\n"
	"		float v = flat_a@;\n"
	"#if STEPS@ == 2\n"
	"		is_flat = is_flat && flat_b@ >= 0.0;\n"
	"		v = mix(v, flat_b@, u_mix@);\n"
	"#endif\n"
	"		float flat_end = is_flat ? end@ : i@;\n"
	"		vec4 colour = shade@(max(v, 0.0));\n"
	"		for (; i@ < flat_end; i@++)\n"
	"			sum += (1.0 - sum.w) * colour;\n"
	"#endif\n"
	"	}\n"
	"}\n"
	"\n"
	"vec4 taken@()\n"
	"{\n"
	"	float v = texture(u_atlas@, at_a@ + i@ * by_a@).x;\n"
	"#if STEPS@ == 2\n"
	"	float w = texture(u_atlas@, at_b@ + i@ * by_b@).x;\n"
	"	v = mix(flat_a@ >= 0.0 ? flat_a@ : v, flat_b@ >= 0.0 ? flat_b@ : w, u_mix@);\n"
	"#elif !ALONE\n"
	"	v = flat_a@ >= 0.0 ? flat_a@ : v;\n"
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
	"		for (; i0 < end0; i0 = min(i0 + every0, end0))\n"
	"			sum += (1.0 - sum.w) * taken0();\n"
	"		i0 = sum.w > 1.0 - OPAQUE ? n0 : i0;\n"
	"	}\n"
	BB_CAST_END;

#endif
