/* What a file may have included before splatshadow.h: the standard headers, and then macros with names that a program
   would like to use itself. Each is a name that a widely used header defines. Its value is an error here: the real
   one of near is empty, and a use of that might go unnoticed. The Makefile's rows
   header.*_plain and header.*_avx2 read this first. */

#ifndef HOSTILE_H
#define HOSTILE_H

#include <assert.h>
#include <ctype.h>
#include <errno.h>
#include <float.h>
#include <limits.h>
#include <locale.h>
#include <math.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <wchar.h>
/* These make names of functions and operators macros by themselves: in C, of all mathematical functions. */
#include <complex.h>
#include <iso646.h>
#include <stdbool.h>
#ifdef __cplusplus
#include <algorithm>
#include <cmath>
using namespace std;
#else
#include <tgmath.h>
#endif
#if defined(__x86_64__) || defined(__i386__)
#include <immintrin.h>
#elif defined(__ARM_NEON)
#include <arm_neon.h>
#endif

/* minwindef.h, windef.h, rpcndr.h, combaseapi.h, winnt.h, winerror.h (windows.h) */
#define near   @
#define far    @
#define NEAR   @
#define FAR    @
#define pascal @
#define cdecl  @
#undef min
#undef max
#define min(a, b)   @
#define max(a, b)   @
#define small       @
#define hyper       @
#define interface   @
#define IN          @
#define OUT         @
#define OPTIONAL    @
#define CONST       @
#define VOID        @
#define TRUE        @
#define FALSE       @
#define CALLBACK    @
#define WINAPI      @
#define THIS        @
#define PURE        @
#define DELETE      @
#define SYNCHRONIZE @
#define NO_ERROR    @
#define S_OK        @
/* winbase.h, winuser.h, wingdi.h, winspool.h, mmsystem.h (windows.h) */
#define ERROR        @
#define Yield()      @
#define environ      @
#define GetObject    @
#define DrawText     @
#define LoadImage    @
#define CreateWindow @
#define GetMessage   @
#define SendMessage  @
#define OPAQUE       @
#define TRANSPARENT  @
#define ABSOLUTE     @
#define RELATIVE     @
#define ALTERNATE    @
#define WINDING      @
#define INFINITE     @
#define IGNORE       @
#define TEXT(x)      @
#define RGB(r, g, b) @
/* dlgs.h (windows.h) */
#define rad1 @
#define grp1 @
#define frm1 @
#define ico1 @
#define stc1 @
#define edt1 @
#define lst1 @
#define cmb1 @
#define chx1 @
#define psh1 @
#define scr1 @
#define rct1 @
#define ctl1 @
/* sal.h of Visual C++ */
#define __in    @
#define __out   @
#define __inout @
/* math.h of Visual C++ and of BSD */
#undef DOMAIN
#define DOMAIN @
#define SING   @
#undef OVERFLOW
#define OVERFLOW @
#undef UNDERFLOW
#define UNDERFLOW @
#define HUGE      @
/* X.h, Xlib.h, Xutil.h, Xos.h (X11) */
#define None         @
#define Bool         @
#define Status       @
#define True         @
#define False        @
#define Always       @
#define Success      @
#define Above        @
#define Below        @
#define Complex      @
#define Convex       @
#define Nonconvex    @
#define CursorShape  @
#define GrayScale    @
#define StaticGray   @
#define TrueColor    @
#define DirectColor  @
#define PseudoColor  @
#define Unsorted     @
#define XYPixmap     @
#define KeyPress     @
#define FocusIn      @
#define Absolute     @
#define index(s, c)  @
#define rindex(s, c) @
/* complex.h, where I is i */
#undef I
#define I @
#undef imaginary
#define imaginary @
/* sys/sysmacros.h, sys/param.h, termios.h, sys/stat.h, netinet/in.h, curses.h */
#undef major
#undef minor
#undef makedev
#define major(x)                               @
#define minor(x)                               @
#define makedev(x, y)                          @
#define MIN(a, b)                              @
#define MAX(a, b)                              @
#define howmany(x, y)                          @
#define roundup(x, y)                          @
#define setbit(a, i)                           @
#define isset(a, i)                            @
#define isclr(a, i)                            @
#define B0                                     @
#define B50                                    @
#define ECHO                                   @
#define st_atime                               @
#define s_addr                                 @
#define h_addr                                 @
#define move(y, x)                             @
#define clear()                                @
#define erase()                                @
#define border(ls, rs, ts, bs, tl, tr, bl, br) @
#define scroll(w)                              @
#define timeout(t)                             @
/* predefined by GNU compilers without -std */
#undef linux
#undef unix
#undef i386
#define linux @
#define unix  @
#define i386  @
/* AssertMacros.h, MacTypes.h, objc.h (macOS) */
#define check(x)          @
#define verify(x)         @
#define require(x, label) @
#define nil               @
#define Nil               @
#define YES               @
#define NO                @
/* Arduino.h, avr/io.h */
#undef abs
#define abs(x)                  ((x) < 0 ? -(x) : (x)) /* the header uses that of stdlib.h, which this agrees with */
#define sq(x)                   @
#define bit(b)                  @
#define radians(x)              @
#define degrees(x)              @
#define constrain(x, low, high) @
#define HIGH                    @
#define LOW                     @
#define INPUT                   @
#define OUTPUT                  @
#define DEFAULT                 @
#define B1                      @
#define F(x)                    @
#define _BV(x)                  @
/* Attributes and checks, as many programs name them */
#define likely(x)                     @
#define unlikely(x)                   @
#define unreachable()                 @
#define container_of(p, type, member) @
#define swap(a, b)                    @
#define clamp(x, low, high)           @
#define force_inline                  @
#define byte                          @
#define uint                          @
#define ARRAY_SIZE(a)                 @
#define COUNT_OF(a)                   @
#define UNUSED(x)                     @
#define ALIGN(x)                      @
#define PACKED                        @
#define EPSILON                       @
#define LOG(x)                        @
#define CHECK(x)                      @
#define ASSERT(x)                     @
/* qglobal.h, qobjectdefs.h (Qt) */
#define signals @
#define slots   @
#define emit    @
#define foreach @
#define forever @
/* Core/Public of Unreal */
#define ensure(x)          @
#define checkf(x, ...)     @
#define PI                 @
#define UPROPERTY(...)     @
#define FORCEINLINE        @
#define LIKELY(x)          @
#define UNLIKELY(x)        @
#define SMALL_NUMBER       @
#define KINDA_SMALL_NUMBER @
#define PLATFORM_WINDOWS   @
/* core/typedefs.h of Godot */
#define ABS(x)              @
#define SIGN(x)             @
#define CLAMP(x, low, high) @
#define SWAP(a, b)          @
#define _FORCE_INLINE_      @
#define memnew(x)           @

#endif
