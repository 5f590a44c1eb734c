/* The C interface of phasestereo: dense stereo matching that stands blur. Made by cbindgen; see docs/c.md.
 *
 *     phasestereo_matcher *matcher = phasestereo_new("robust", NULL, 0, 0);
 *     if (phasestereo_match(matcher, &left, &right, 0, 64, &map, NULL) != PHASESTEREO_STATUS_OK) puts(phasestereo_error());
 *     phasestereo_free(matcher);
 */

#ifndef PHASESTEREO_H
#define PHASESTEREO_H

#include <stddef.h>
#include <stdint.h>

/**
 * Most kinds of blur in one image.
 */
#define PHASESTEREO_MOST_BLURS 8

/**
 * Coefficients of the field of vertical offsets.
 */
#define PHASESTEREO_TERMS 8

/**
 * Neither image: both are alike.
 */
#define PHASESTEREO_NEITHER 0

/**
 * The left image.
 */
#define PHASESTEREO_LEFT 1

/**
 * The right image.
 */
#define PHASESTEREO_RIGHT 2

/**
 * No blur.
 */
#define PHASESTEREO_NO_BLUR 0

/**
 * A Gaussian; its size is the standard deviation.
 */
#define PHASESTEREO_GAUSSIAN 1

/**
 * Defocus; its size is the radius.
 */
#define PHASESTEREO_DISK 2

/**
 * A straight motion; its size is the length.
 */
#define PHASESTEREO_MOTION 3

/**
 * Defocus of a lens whose middle is covered; its size is the outer radius.
 */
#define PHASESTEREO_ANNULUS 4

/**
 * None of these families; its size is the root mean square radius.
 */
#define PHASESTEREO_OTHER 5

/**
 * The disparities were given by the caller.
 */
#define PHASESTEREO_GIVEN 0

/**
 * The disparities were estimated from the images.
 */
#define PHASESTEREO_FOUND 1

/**
 * The range could not be estimated: the disparities are a third of the width.
 */
#define PHASESTEREO_DEFAULT 2

/**
 * One channel.
 */
#define PHASESTEREO_GRAY 0

/**
 * Red, green, blue.
 */
#define PHASESTEREO_RGB 1

/**
 * Red, green, blue, and a fourth channel that is left out.
 */
#define PHASESTEREO_RGBA 2

/**
 * Blue, green, red, as `OpenCV` has them.
 */
#define PHASESTEREO_BGR 3

/**
 * Blue, green, red, and a fourth channel that is left out.
 */
#define PHASESTEREO_BGRA 4

/**
 * No candidate has a valid pixel in the right image: there is no estimate.
 */
#define PHASESTEREO_NO_CANDIDATE 2

/**
 * The match lies outside the right image.
 */
#define PHASESTEREO_OUTSIDE 4

/**
 * The left pixel is not seen in the right image: the right pixel of its match belongs to another one.
 */
#define PHASESTEREO_OCCLUDED 16

/**
 * The match belongs to another left pixel, too, although the right image sees this one.
 */
#define PHASESTEREO_MISMATCHED 32

/**
 * Another candidate costs about as much.
 */
#define PHASESTEREO_LOW_CONFIDENCE 64

/**
 * The pixel belongs to a small region that differs from all around it.
 */
#define PHASESTEREO_SPECKLE 128

/**
 * The disparity is that of other pixels: this one's own is not trusted.
 */
#define PHASESTEREO_FILLED 256

/**
 * A disparity elsewhere fits nearly as well.
 */
#define PHASESTEREO_AMBIGUOUS 512

/**
 * How a call ended.
 */
typedef enum phasestereo_status {
  /**
   * All is done.
   */
  PHASESTEREO_STATUS_OK = 0,
  /**
   * An argument is not acceptable: `phasestereo_error` names it, what it got and what it accepts.
   */
  PHASESTEREO_STATUS_INVALID_ARGUMENT = 1,
  /**
   * The working memory could not be had.
   */
  PHASESTEREO_STATUS_OUT_OF_MEMORY = 2,
  /**
   * The system refused to start the threads.
   */
  PHASESTEREO_STATUS_THREADS = 3,
  /**
   * A fault of the library, which should be reported.
   */
  PHASESTEREO_STATUS_INTERNAL = 4,
} phasestereo_status;

/**
 * Settings, threads and working memory; any number of threads may use one at the same time.
 */
typedef struct phasestereo_matcher phasestereo_matcher;

/**
 * A setting by its name, both as text that ends with a zero. Names, meanings and ranges are those of the class `Settings`
 * of the Python package; values are written as there, "none" and "true" or "false" in small letters, pairs as "0, 4095".
 */
typedef struct phasestereo_setting {
  /**
   * Its name, as "median".
   */
  const char *name;
  /**
   * Its value, as "3".
   */
  const char *value;
} phasestereo_setting;

/**
 * An image in memory; it is read only during the call.
 */
typedef struct phasestereo_image {
  /**
   * The first pixel of the first row.
   */
  const void *data;
  /**
   * Bytes from a row to the next one: negative where the last row comes first in memory.
   */
  ptrdiff_t stride;
  /**
   * Columns.
   */
  uint32_t width;
  /**
   * Rows.
   */
  uint32_t height;
  /**
   * Channels, side by side: `PHASESTEREO_GRAY`, `PHASESTEREO_RGB` and so on
   */
  uint32_t channels;
  /**
   * Bits of a channel: 8, or 16 in the byte order of the machine.
   */
  uint32_t bits;
} phasestereo_image;

/**
 * The memory that a disparity map is written to: planes of as many rows and columns as the images have. NULL: not
 * wanted.
 */
typedef struct phasestereo_map {
  /**
   * Disparities, pixels; NaN where there is none.
   */
  float *disparity;
  /**
   * Bytes from a row to the next one.
   */
  ptrdiff_t disparity_stride;
  /**
   * Flags: the sum of `PHASESTEREO_OUTSIDE`, `PHASESTEREO_OCCLUDED` and so on.
   */
  uint16_t *flags;
  /**
   * Bytes from a row to the next one.
   */
  ptrdiff_t flags_stride;
  /**
   * Confidences from 0 to 1; all NaN where the settings, as those of "fast", compute none.
   */
  float *confidence;
  /**
   * Bytes from a row to the next one.
   */
  ptrdiff_t confidence_stride;
} phasestereo_map;

/**
 * A kind of relative blur: what one image lacks to be like the other.
 */
typedef struct phasestereo_blur {
  /**
   * Its size, pixels.
   */
  double size;
  /**
   * Direction of a motion, degrees in [0, 180): 0 is along x, 90 along y.
   */
  double angle;
  /**
   * The share of the image that has it.
   */
  double share;
  /**
   * The softer image: `PHASESTEREO_NEITHER`, `PHASESTEREO_LEFT` or `PHASESTEREO_RIGHT`.
   */
  uint32_t side;
  /**
   * Its family: `PHASESTEREO_NO_BLUR`, `PHASESTEREO_GAUSSIAN` and so on
   */
  uint32_t kind;
} phasestereo_blur;

/**
 * What was estimated from a pair. Numbers that were not estimated, or could not be, are NaN, and counts are 0.
 */
typedef struct phasestereo_found {
  /**
   * Mean confidence, 0 to 1, of a rough match of small copies.
   */
  double confidence;
  /**
   * Least disparity found, pixels.
   */
  double low;
  /**
   * Largest disparity found, pixels.
   */
  double high;
  /**
   * The field of vertical offsets v: what is at row y of the left image is at y + v of the right one. With X and Y from
   * -1 to 1 over the columns of the right and the rows of the left image, and `R2 = X^2 + Y^2`, it is
   * `c0 + c1 X + c2 Y + c3 X Y + c4 X^2 + c5 Y^2 + c6 Y R2 + c7 X R2`, in pixels.
   */
  double rows[PHASESTEREO_TERMS];
  /**
   * Root mean square of v over the image, pixels.
   */
  double rows_rms;
  /**
   * Its standard error, pixels.
   */
  double rows_error;
  /**
   * Robust standard deviation of the blocks from it, pixels.
   */
  double rows_spread;
  /**
   * Certainty of the first of `blurs`, from 0 to 1: by how much better it explains its part of the images than the
   * opposite.
   */
  double certainty;
  /**
   * Contrast of the left image relative to the right one.
   */
  double contrast;
  /**
   * Standard deviations of the noise, left and right, in units of the pixels.
   */
  double noise[2];
  /**
   * Least height by which hot, dead and stuck pixels stand out, left and right; 0: there are none.
   */
  double impulses[2];
  /**
   * Loss of compression in blocks, left and right, as the standard deviation of a noise that would do as much harm.
   */
  double coding[2];
  /**
   * The kinds of blur, that of the largest area first. Where each image lacks something that the other one has, both
   * blurs are there, one after the other, with the same share.
   */
  struct phasestereo_blur blurs[PHASESTEREO_MOST_BLURS];
  /**
   * Number of kinds of blur; 0: blur was not estimated.
   */
  uint32_t num_blurs;
  /**
   * Number of blocks of the images that agree with the field; 0: there is none.
   */
  uint32_t rows_blocks;
  /**
   * 1: the right image was straightened by the field.
   */
  uint32_t rows_applied;
  /**
   * Smallest disparity that is searched.
   */
  int32_t min_disparity;
  /**
   * Number of disparities that are searched.
   */
  int32_t num_disparities;
  /**
   * Origin of the disparities: `PHASESTEREO_GIVEN`, `PHASESTEREO_FOUND` or `PHASESTEREO_DEFAULT`.
   */
  uint32_t origin;
  /**
   * 1: nearly all disparities are clearly negative, as where left and right are swapped.
   */
  uint32_t swapped;
  /**
   * 1: many disparities of either sign are clearly not zero.
   */
  uint32_t mixed;
  /**
   * 1: the images match once one of them is inverted, and not before.
   */
  uint32_t inverted;
} phasestereo_found;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * The version of the library, as "0.1.0".
 */
const char *phasestereo_version(void);

/**
 * The message of the last call on this thread that failed; empty if none has. It is valid until the next call that
 * fails.
 */
const char *phasestereo_error(void);

/**
 * Makes a matcher with the settings of a preset, "robust", "fast" or "paper" (NULL: "robust"), but for those that are
 * listed; `threads` is 1 to 1024, or 0: as many as the process may use. NULL if it fails: see `phasestereo_error`.
 *
 * Texts end with a zero; `settings` are `count` of them, or NULL where `count` is 0.
 */
struct phasestereo_matcher *phasestereo_new(const char *preset,
                                            const struct phasestereo_setting *settings,
                                            size_t count,
                                            uint32_t threads);

/**
 * Frees a matcher with its threads and its memory. NULL is ignored.
 *
 * The matcher is one of `phasestereo_new`, no call is using it, and none will.
 */
void phasestereo_free(struct phasestereo_matcher *matcher);

/**
 * The number of threads of a matcher; 0 of NULL.
 *
 * The matcher is one of `phasestereo_new`, or NULL.
 */
uint32_t phasestereo_threads(const struct phasestereo_matcher *matcher);

/**
 * The most bytes of working memory that the match of images takes, whose pixels, all channels together, take
 * `pixel_bytes` each; 0 if an argument is not acceptable. Images and maps of the caller are not included, nor the
 * codes of the right image that are kept for each kind of blur that is compensated for.
 *
 * The matcher is one of `phasestereo_new`.
 */
uint64_t phasestereo_memory(const struct phasestereo_matcher *matcher,
                            uint32_t width,
                            uint32_t height,
                            uint32_t pixel_bytes,
                            uint32_t num_disparities);

/**
 * Matches a rectified pair of images of one size and number of bits. The disparities [`min_disparity`, `min_disparity` +
 * `num_disparities`) are searched, `num_disparities` from 1 to the width; with 0 the range is estimated, and
 * `min_disparity` is 0. Left pixel (x, y) corresponds to right pixel (x - d, y). What was estimated from the pair is written
 * to `found`, unless that is NULL. If the call fails, nothing is written.
 *
 * Pointers are to what their types say; the planes of `map` have rows of as many values as the images have columns, and
 * as many rows.
 */
enum phasestereo_status phasestereo_match(const struct phasestereo_matcher *matcher,
                                          const struct phasestereo_image *left,
                                          const struct phasestereo_image *right,
                                          int32_t min_disparity,
                                          int32_t num_disparities,
                                          const struct phasestereo_map *map,
                                          struct phasestereo_found *found);

/**
 * Estimates from a pair what a match with these settings would estimate: the disparities, if they are not given, how
 * rows correspond, blur, noise. The arguments are those of `phasestereo_match`.
 *
 * Pointers are to what their types say.
 */
enum phasestereo_status phasestereo_check(const struct phasestereo_matcher *matcher,
                                          const struct phasestereo_image *left,
                                          const struct phasestereo_image *right,
                                          int32_t min_disparity,
                                          int32_t num_disparities,
                                          struct phasestereo_found *found);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* PHASESTEREO_H */
