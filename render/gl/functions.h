/*
 * render/gl/functions.h: the OpenGL functions that are used, one row each, fetched from the context at run time. No GL
 * library is linked.
 */
#ifndef BB_RENDER_GL_FUNCTIONS_H
#define BB_RENDER_GL_FUNCTIONS_H

#include <GL/glcorearb.h>

#include "hal/base.h"

#define BB_GL_FUNCTIONS(X)                                           \
	X(PFNGLACTIVETEXTUREPROC, ActiveTexture)                     \
	X(PFNGLATTACHSHADERPROC, AttachShader)                       \
	X(PFNGLBINDBUFFERPROC, BindBuffer)                           \
	X(PFNGLBINDFRAMEBUFFERPROC, BindFramebuffer)                 \
	X(PFNGLBINDRENDERBUFFERPROC, BindRenderbuffer)               \
	X(PFNGLBINDTEXTUREPROC, BindTexture)                         \
	X(PFNGLBINDVERTEXARRAYPROC, BindVertexArray)                 \
	X(PFNGLBUFFERDATAPROC, BufferData)                           \
	X(PFNGLBUFFERSUBDATAPROC, BufferSubData)                     \
	X(PFNGLCHECKFRAMEBUFFERSTATUSPROC, CheckFramebufferStatus)   \
	X(PFNGLCOMPILESHADERPROC, CompileShader)                     \
	X(PFNGLCREATEPROGRAMPROC, CreateProgram)                     \
	X(PFNGLCREATESHADERPROC, CreateShader)                       \
	X(PFNGLDELETEBUFFERSPROC, DeleteBuffers)                     \
	X(PFNGLDELETEFRAMEBUFFERSPROC, DeleteFramebuffers)           \
	X(PFNGLDELETEPROGRAMPROC, DeleteProgram)                     \
	X(PFNGLDELETERENDERBUFFERSPROC, DeleteRenderbuffers)         \
	X(PFNGLDELETESHADERPROC, DeleteShader)                       \
	X(PFNGLDELETETEXTURESPROC, DeleteTextures)                   \
	X(PFNGLDELETEVERTEXARRAYSPROC, DeleteVertexArrays)           \
	X(PFNGLDISABLEPROC, Disable)                                 \
	X(PFNGLDRAWARRAYSPROC, DrawArrays)                           \
	X(PFNGLFRAMEBUFFERRENDERBUFFERPROC, FramebufferRenderbuffer) \
	X(PFNGLGENBUFFERSPROC, GenBuffers)                           \
	X(PFNGLGENFRAMEBUFFERSPROC, GenFramebuffers)                 \
	X(PFNGLGENRENDERBUFFERSPROC, GenRenderbuffers)               \
	X(PFNGLGENTEXTURESPROC, GenTextures)                         \
	X(PFNGLGENVERTEXARRAYSPROC, GenVertexArrays)                 \
	X(PFNGLGETERRORPROC, GetError)                               \
	X(PFNGLGETINTEGERVPROC, GetIntegerv)                         \
	X(PFNGLGETPROGRAMINFOLOGPROC, GetProgramInfoLog)             \
	X(PFNGLGETPROGRAMIVPROC, GetProgramiv)                       \
	X(PFNGLGETSHADERINFOLOGPROC, GetShaderInfoLog)               \
	X(PFNGLGETSHADERIVPROC, GetShaderiv)                         \
	X(PFNGLGETSTRINGPROC, GetString)                             \
	X(PFNGLGETUNIFORMLOCATIONPROC, GetUniformLocation)           \
	X(PFNGLLINKPROGRAMPROC, LinkProgram)                         \
	X(PFNGLMAPBUFFERRANGEPROC, MapBufferRange)                   \
	X(PFNGLPIXELSTOREIPROC, PixelStorei)                         \
	X(PFNGLREADPIXELSPROC, ReadPixels)                           \
	X(PFNGLRENDERBUFFERSTORAGEPROC, RenderbufferStorage)         \
	X(PFNGLSHADERSOURCEPROC, ShaderSource)                       \
	X(PFNGLTEXBUFFERPROC, TexBuffer)                             \
	X(PFNGLTEXIMAGE1DPROC, TexImage1D)                           \
	X(PFNGLTEXIMAGE2DPROC, TexImage2D)                           \
	X(PFNGLTEXIMAGE3DPROC, TexImage3D)                           \
	X(PFNGLTEXPARAMETERIPROC, TexParameteri)                     \
	X(PFNGLTEXSUBIMAGE3DPROC, TexSubImage3D)                     \
	X(PFNGLUNIFORM1FPROC, Uniform1f)                             \
	X(PFNGLUNIFORM1IPROC, Uniform1i)                             \
	X(PFNGLUNIFORM2FPROC, Uniform2f)                             \
	X(PFNGLUNIFORM3FPROC, Uniform3f)                             \
	X(PFNGLUNIFORM4FPROC, Uniform4f)                             \
	X(PFNGLUNMAPBUFFERPROC, UnmapBuffer)                         \
	X(PFNGLUSEPROGRAMPROC, UseProgram)                           \
	X(PFNGLVIEWPORTPROC, Viewport)

struct bb_gl {
#define X(type, name) type name;
	BB_GL_FUNCTIONS(X)
#undef X
};

typedef void (*bb_gl_function)(void);

/* Fetch all of them; the name of the first that is missing, or NULL. */
const char *bb_gl_load(struct bb_gl *gl, bb_gl_function (*get)(void *ctx, const char *name), void *ctx);

#endif
