/* OpenGL and OpenGL ES without a screen, by EGL, for tests that run shaders. Libraries are opened at run time, so that
   a machine without them builds the tests, too. */

#ifndef OFFSCREEN_H
#define OFFSCREEN_H

#include "check.h"

#include <stddef.h>

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define OFFSCREEN_LACK "drivers run without sanitizers only"
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer) || __has_feature(memory_sanitizer)
#define OFFSCREEN_LACK "drivers run without sanitizers only"
#endif
#endif
#ifdef __GLIBC__
#if !__GLIBC_PREREQ(2, 34) /* needs -ldl */
#define OFFSCREEN_LACK "the C library keeps dlopen in another one"
#endif
#endif
#if !defined(OFFSCREEN_LACK) && !defined(__unix__)
#define OFFSCREEN_LACK "there is no dlopen here"
#endif
#ifndef OFFSCREEN_LACK
#include <dlfcn.h>
#endif

#define OFFSCREEN_UNIFORMS 0x8A11

typedef void (*offscreen_fn)(void);

/* Functions of OpenGL, by their names without gl. */
typedef struct offscreen {
    unsigned (*CreateShader)(unsigned kind);
    void (*ShaderSource)(unsigned shader, int count, const char *const *texts, const int *lengths);
    void (*CompileShader)(unsigned shader);
    void (*GetShaderiv)(unsigned shader, unsigned name, int *value);
    void (*GetShaderInfoLog)(unsigned shader, int size, int *length, char *text);
    unsigned (*CreateProgram)(void);
    void (*AttachShader)(unsigned program, unsigned shader);
    void (*LinkProgram)(unsigned program);
    void (*GetProgramiv)(unsigned program, unsigned name, int *value);
    void (*GetProgramInfoLog)(unsigned program, int size, int *length, char *text);
    void (*UseProgram)(unsigned program);
    int (*GetUniformLocation)(unsigned program, const char *name);
    void (*Uniform1i)(int location, int value);
    void (*Uniform4f)(int location, float x, float y, float z, float w);
    unsigned (*GetUniformBlockIndex)(unsigned program, const char *name);
    void (*UniformBlockBinding)(unsigned program, unsigned block, unsigned binding);
    void (*GenBuffers)(int count, unsigned *names);
    void (*BindBufferBase)(unsigned target, unsigned index, unsigned buffer);
    void (*BufferData)(unsigned target, ptrdiff_t size, const void *data, unsigned usage);
    void (*GenTextures)(int count, unsigned *names);
    void (*ActiveTexture)(unsigned unit);
    void (*BindTexture)(unsigned target, unsigned texture);
    void (*TexParameteri)(unsigned target, unsigned name, int value);
    void (*TexImage2D)(unsigned target, int level, int kind, int width, int height, int border, unsigned format,
                       unsigned type, const void *data);
    void (*TexImage3D)(unsigned target, int level, int kind, int width, int height, int depth, int border,
                       unsigned format, unsigned type, const void *data);
    void (*PixelStorei)(unsigned name, int value);
    void (*GenFramebuffers)(int count, unsigned *names);
    void (*BindFramebuffer)(unsigned target, unsigned framebuffer);
    void (*FramebufferTexture2D)(unsigned target, unsigned place, unsigned kind, unsigned texture, int level);
    unsigned (*CheckFramebufferStatus)(unsigned target);
    void (*GenVertexArrays)(int count, unsigned *names);
    void (*BindVertexArray)(unsigned array);
    void (*Viewport)(int x, int y, int width, int height);
    void (*DrawArrays)(unsigned mode, int first, int count);
    void (*ReadPixels)(int x, int y, int width, int height, unsigned format, unsigned type, void *pixels);
    unsigned (*GetError)(void);
    offscreen_fn (*find)(const char *name);
    int (*make_current)(void *display, void *draw, void *read, void *context);
    int (*destroy)(void *display, void *context);
    void *library, *display, *context;
    int width, height;
    unsigned textures[4];
} offscreen;

typedef struct offscreen_name {
    const char *name;
    size_t place;
} offscreen_name;

#define OFFSCREEN_NAME(name)                                                                                           \
    { "gl" #name, offsetof(offscreen, name) }

/* 1: found all. */
static inline int offscreen_find_all(offscreen *gl) {
    static const offscreen_name names[] = {OFFSCREEN_NAME(CreateShader),
                                           OFFSCREEN_NAME(ShaderSource),
                                           OFFSCREEN_NAME(CompileShader),
                                           OFFSCREEN_NAME(GetShaderiv),
                                           OFFSCREEN_NAME(GetShaderInfoLog),
                                           OFFSCREEN_NAME(CreateProgram),
                                           OFFSCREEN_NAME(AttachShader),
                                           OFFSCREEN_NAME(LinkProgram),
                                           OFFSCREEN_NAME(GetProgramiv),
                                           OFFSCREEN_NAME(GetProgramInfoLog),
                                           OFFSCREEN_NAME(UseProgram),
                                           OFFSCREEN_NAME(GetUniformLocation),
                                           OFFSCREEN_NAME(Uniform1i),
                                           OFFSCREEN_NAME(Uniform4f),
                                           OFFSCREEN_NAME(GetUniformBlockIndex),
                                           OFFSCREEN_NAME(UniformBlockBinding),
                                           OFFSCREEN_NAME(GenBuffers),
                                           OFFSCREEN_NAME(BindBufferBase),
                                           OFFSCREEN_NAME(BufferData),
                                           OFFSCREEN_NAME(GenTextures),
                                           OFFSCREEN_NAME(ActiveTexture),
                                           OFFSCREEN_NAME(BindTexture),
                                           OFFSCREEN_NAME(TexParameteri),
                                           OFFSCREEN_NAME(TexImage2D),
                                           OFFSCREEN_NAME(TexImage3D),
                                           OFFSCREEN_NAME(PixelStorei),
                                           OFFSCREEN_NAME(GenFramebuffers),
                                           OFFSCREEN_NAME(BindFramebuffer),
                                           OFFSCREEN_NAME(FramebufferTexture2D),
                                           OFFSCREEN_NAME(CheckFramebufferStatus),
                                           OFFSCREEN_NAME(GenVertexArrays),
                                           OFFSCREEN_NAME(BindVertexArray),
                                           OFFSCREEN_NAME(Viewport),
                                           OFFSCREEN_NAME(DrawArrays),
                                           OFFSCREEN_NAME(ReadPixels),
                                           OFFSCREEN_NAME(GetError)};
    for (size_t i = 0; i < sizeof names / sizeof *names; ++i) {
        const offscreen_fn found = gl->find(names[i].name);
        if (!found) return 0;
        memcpy((char *)gl + names[i].place, &found, sizeof found);
    }
    return 1;
}

#ifdef OFFSCREEN_LACK
static inline const char *offscreen_open(offscreen *gl, int es) {
    (void)gl, (void)es;
    return OFFSCREEN_LACK;
}

static inline void offscreen_end(offscreen *gl) { (void)gl; }
#else
/* A function of EGL, into a pointer to it. */
static inline int offscreen_egl(const offscreen *gl, const char *name, void *to) {
    void *found = dlsym(gl->library, name);
    memcpy(to, &found, sizeof found);
    return found != NULL;
}

/* Opens a context of OpenGL 4.3 core or OpenGL ES 3.1, by software. Returns what is missing, or "". */
static inline const char *offscreen_open(offscreen *gl, int es) {
    static const int wanted[2][7] = {{0x3098, 4, 0x30FB, 3, 0x30FD, 1, 0x3038}, {0x3098, 3, 0x30FB, 1, 0x3038, 0, 0}};
    void *(*get_display)(unsigned platform, void *native, const ptrdiff_t *attributes) = NULL;
    int (*initialize)(void *display, int *major, int *minor) = NULL;
    int (*bind_api)(unsigned api) = NULL;
    void *(*create)(void *display, void *config, void *shared, const int *attributes) = NULL;
    setenv("LIBGL_ALWAYS_SOFTWARE", "1", 1);
    gl->library = dlopen("libEGL.so.1", RTLD_NOW | RTLD_LOCAL);
    if (!gl->library) return "install libegl1";
    if (!offscreen_egl(gl, "eglGetPlatformDisplay", &get_display) || !offscreen_egl(gl, "eglInitialize", &initialize) ||
        !offscreen_egl(gl, "eglBindAPI", &bind_api) || !offscreen_egl(gl, "eglCreateContext", &create) ||
        !offscreen_egl(gl, "eglMakeCurrent", &gl->make_current) ||
        !offscreen_egl(gl, "eglDestroyContext", &gl->destroy) || !offscreen_egl(gl, "eglGetProcAddress", &gl->find))
        return "EGL is older than 1.5";
    gl->display = get_display(0x31DD, NULL, NULL); /* surfaceless */
    if (!gl->display || !initialize(gl->display, NULL, NULL) || !bind_api(es ? 0x30A0 : 0x30A2))
        return "install libegl-mesa0 and libgl1-mesa-dri";
    gl->context = create(gl->display, NULL, NULL, wanted[es]);
    if (!gl->context || !gl->make_current(gl->display, NULL, NULL, gl->context)) return "there is no such context";
    return offscreen_find_all(gl) ? "" : "functions are missing";
}

/* Drivers stay loaded: other contexts may follow. */
static inline void offscreen_end(offscreen *gl) {
    if (gl->context) gl->make_current(gl->display, NULL, NULL, NULL);
    if (gl->context) gl->destroy(gl->display, gl->context);
}
#endif

/* Internal format, format and type as OpenGL numbers them. */
typedef struct offscreen_format {
    int inner;
    unsigned outer, type;
} offscreen_format;

/* Replaces the texture of a unit: an array of size[2] layers, or a picture if that is 0. Clamped; arrays of RGBA are
   filtered. */
static inline void offscreen_texture(offscreen *gl, unsigned unit, const offscreen_format *format, const int size[3],
                                     const void *data) {
    const unsigned target = size[2] > 0 ? 0x8C1A : 0x0DE1;
    const int filter = size[2] > 0 && format->outer == 0x1908 ? 0x2601 : 0x2600;
    gl->ActiveTexture(0x84C0 + unit);
    gl->BindTexture(target, gl->textures[unit]);
    if (size[2] > 0)
        gl->TexImage3D(target, 0, format->inner, size[0], size[1], size[2], 0, format->outer, format->type, data);
    else
        gl->TexImage2D(target, 0, format->inner, size[0], size[1], 0, format->outer, format->type, data);
    gl->TexParameteri(target, 0x2800, filter);
    gl->TexParameteri(target, 0x2801, filter);
    gl->TexParameteri(target, 0x2802, 0x812F);
    gl->TexParameteri(target, 0x2803, 0x812F);
}

/* Opens, with a framebuffer of floats. Returns 0 if something is missing, and says what. */
static inline int offscreen_begin(offscreen *gl, int es, int width, int height, const char **lack) {
    const offscreen_format floats = {0x8814, 0x1908, 0x1406};
    const int size[3] = {width, height, 0};
    unsigned name;
    memset(gl, 0, sizeof *gl);
    *lack = offscreen_open(gl, es);
    if (**lack) return 0;
    gl->width = width, gl->height = height;
    gl->GenTextures(4, gl->textures);
    gl->PixelStorei(0x0CF5, 1);
    gl->PixelStorei(0x0D05, 1);
    offscreen_texture(gl, 2, &floats, size, NULL);
    gl->GenFramebuffers(1, &name);
    gl->BindFramebuffer(0x8D40, name);
    gl->FramebufferTexture2D(0x8D40, 0x8CE0, 0x0DE1, gl->textures[2], 0);
    if (gl->CheckFramebufferStatus(0x8D40) != 0x8CD5) *lack = "floats cannot be drawn";
    gl->GenVertexArrays(1, &name);
    gl->BindVertexArray(name);
    gl->GenBuffers(1, &name);
    gl->BindBufferBase(OFFSCREEN_UNIFORMS, 2, name);
    return !**lack;
}

static inline unsigned offscreen_shader(offscreen *gl, unsigned kind, const char *const texts[3]) {
    const unsigned shader = gl->CreateShader(kind);
    char log[2000] = "";
    int good = 0;
    gl->ShaderSource(shader, 3, texts, NULL);
    gl->CompileShader(shader);
    gl->GetShaderiv(shader, 0x8B81, &good);
    if (!good) gl->GetShaderInfoLog(shader, sizeof log, NULL, log);
    if (!good) printf("    %s    %s\n", texts[0], log);
    return good ? shader : 0;
}

/* A program of two shaders of three strings each, or 0, with what the compiler says. */
static inline unsigned offscreen_program(offscreen *gl, const char *const vertex[3], const char *const fragment[3]) {
    const unsigned shaders[2] = {offscreen_shader(gl, 0x8B31, vertex), offscreen_shader(gl, 0x8B30, fragment)};
    const unsigned program = gl->CreateProgram();
    char log[2000] = "";
    int good = 0;
    if (!shaders[0] || !shaders[1]) return 0;
    gl->AttachShader(program, shaders[0]);
    gl->AttachShader(program, shaders[1]);
    gl->LinkProgram(program);
    gl->GetProgramiv(program, 0x8B82, &good);
    if (!good) gl->GetProgramInfoLog(program, sizeof log, NULL, log);
    if (!good) printf("    %s\n", log);
    return good ? program : 0;
}

/* Draws a triangle over all pixels, and reads them from the lowest row on. */
static inline void offscreen_draw(offscreen *gl, float *rgba) {
    gl->Viewport(0, 0, gl->width, gl->height);
    gl->DrawArrays(4, 0, 3);
    gl->ReadPixels(0, 0, gl->width, gl->height, 0x1908, 0x1406, rgba);
}

#endif /* OFFSCREEN_H */
