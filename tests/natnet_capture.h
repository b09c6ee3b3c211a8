/*
 * tests/natnet_capture.h: what two frames, a model definition, a hello and an echo of Motive 2.1 said, as numbers, and the
 * SHA-256 of the datagrams as they came: written by us from the numbers they must have that sum. The captures are those
 * of the tests of python_natnet (BSD-3-Clause), which hold them as bytes.
 */
#ifndef BB_TESTS_NATNET_CAPTURE_H
#define BB_TESTS_NATNET_CAPTURE_H

#include "drivers/mocap/natnet.h"

static const char capture_frame_sha256[] = "b0fdf27bf39ee515d97b8d28040293196f9b506fe04d868bd62bd9768ddcee3f";
static const struct natnet_message capture_frame = {
	.id = NATNET_FRAME,
	.frame = { .number = 162734,
	  .n_sets = 0,
	  .n_unlabelled = 5,
	  .unlabelled = { { 0.12721622F, 1.50502753F, -0.885828376F },
		{ 0.208985209F, 1.48328066F, -0.712186635F },
		{ -0.04574164F, 1.43104291F, -0.831302226F },
		{ 0.18133828F, 1.43583381F, -0.653594255F },
		{ 0.321398914F, 1.41465127F, -0.752953768F } },
	  .n_bodies = 1,
	  .body = { { 2, { 0.174446642F, 1.4471314F, -0.734304011F },
		  { -0.0545942336F, 0.509948194F, 0.043703571F, -0.857357681F }, 0.000515220338F, 1 } },
	  .n_markers = 6,
	  .marker = { { 0x20001, { 0.12721622F, 1.50502753F, -0.885828376F }, 0.0214398205F, 10, 0.000207482837F },
		{ 0x20002, { 0.208985209F, 1.48328066F, -0.712186635F }, 0.0208847895F, 10, 0.000539067667F },
		{ 0x20003, { -0.04574164F, 1.43104291F, -0.831302226F }, 0.0208090749F, 10, 0.000689117529F },
		{ 0x20004, { 0.18133828F, 1.43583381F, -0.653594255F }, 0.0192695074F, 10, 0.00038372734F },
		{ 0x20005, { 0.321398914F, 1.41465127F, -0.752953768F }, 0.0212247409F, 10, 0.000635738776F },
		{ 0xc357, { 0.170811653F, 1.50765908F, -0.840234637F }, 0.0201573446F, 18, 0.000559378299F } },
	  .timecode = 0, .timecode_sub = 0, .timestamp_s = 1356.1166666666666, .mid_exposure = 1416497730518U,
	  .received = 1416497745808U, .transmitted = 1416497748722U, .params = 0,
	  .has_end = true, .end = 0 },
};

static const char capture_occluded_sha256[] = "721537c5c606052b4d1bbb18031fadd07c9a4f159052efbc9629afc0cee8915e";
static const struct natnet_message capture_occluded = {
	.id = NATNET_FRAME,
	.frame = { .number = 269007,
	  .n_sets = 2,
	  .set = { { "FakeTree", 5, { { -0.168483421F, 0.283186644F, 0.490805507F },
		  { -0.139901891F, 0.473624289F, 0.44168669F },
		  { -0.120278075F, 0.18182461F, 0.462637722F },
		  { -0.241419077F, 0.214492083F, 0.4675152F },
		  { -0.100575335F, 0.261596322F, 0.490676284F } } },
		{ "all", 5, { { -0.168483421F, 0.283186644F, 0.490805507F },
		  { -0.139901891F, 0.473624289F, 0.44168669F },
		  { -0.120278075F, 0.18182461F, 0.462637722F },
		  { -0.241419077F, 0.214492083F, 0.4675152F },
		  { -0.100575335F, 0.261596322F, 0.490676284F } } } },
	  .n_unlabelled = 0,
	  .n_bodies = 1,
	  .body = { { 7, { -0.154131562F, 0.282944798F, 0.470664322F },
		  { -0.000333928881F, -0.000148212755F, 0.00524857594F, -0.999986172F }, 6.20881702e-09F, 1 } },
	  .n_markers = 4,
	  .marker = { { 0x70002, { -0.139901891F, 0.473624289F, 0.44168669F }, 0.0208280422F, 11, 5.08858284e-05F },
		{ 0x70003, { -0.120278075F, 0.18182461F, 0.462637722F }, 0.0234863684F, 10, 0.000544939772F },
		{ 0x70004, { -0.241419077F, 0.214492083F, 0.4675152F }, 0.0217074174F, 10, 0.000144848716F },
		{ 0x70005, { -0.100575335F, 0.261596322F, 0.490676284F }, 0.0235295761F, 10, 0.000500721624F } },
	  .timecode = 0, .timecode_sub = 0, .timestamp_s = 8966.9, .mid_exposure = 8642283567331U,
	  .received = 8642283582567U, .transmitted = 8642283586925U, .params = 0,
	  .has_end = true, .end = 0 },
};

static const char capture_models_sha256[] = "6948359c2a16eb98568780beb308db12d48b55eaa1daabf054ee2eda081e768e";
static const struct natnet_message capture_models = {
	.id = NATNET_MODELS,
	.models = { .n = 3,
	  .model = { { .kind = 1, .name = "RaceQuad", .id = 2, .parent = -1, .offset = { 0.0F, 0.0F, 0.0F }, .n_markers = 5,
		  .at = { { 0.161158994F, 0.0350515991F, -0.0321813002F },
			  { -0.0308190007F, 0.0397818983F, -0.0219900999F },
			  { 0.187530994F, -0.0333832987F, 0.148081005F },
			  { -0.0748715028F, 6.68607026e-05F, 0.0329232998F },
			  { -0.0580382012F, -0.0319418982F, -0.136806995F } },
		  .label = { 0, 0, 0, 0, 0 } },
		{ .kind = 0, .name = "RaceQuad", .n_markers = 5, .marker = { "Marker1", "Marker2", "Marker3", "Marker4", "Marker5" } },
		{ .kind = 0, .name = "all", .n_markers = 5, .marker = { "RaceQuad_1", "RaceQuad_2", "RaceQuad_3", "RaceQuad_4", "RaceQuad_5" } } } },
};

static const char capture_connect_sha256[] = "c130658a3a909d1694e7f062a91da7472b42a96587f40a425633f06534c71061";
static const struct natnet_message capture_connect = {
	.id = NATNET_CONNECT,
	.hello = { .name = "NatNetLib", .version = { 3, 0, 0, 0 }, .natnet_version = { 3, 0, 0, 0 } },
};

static const char capture_echo_sha256[] = "ebf7a521bea6d1899e09a37432f44254e8567f0c0deb5412433600375a7461d4";
static const struct natnet_message capture_echo = {
	.id = NATNET_ECHO_RESPONSE,
	.echo = { .sent = 278554190U, .received = 1416498545924U },
};

#endif
