/*
 * ReAgent point cloud registration. Made by cbindgen from core/capi/src: do not edit.
 *
 * Order of calls: reagent_init once; reagent_set_target, reagent_set_source and then reagent_step as often
 * as steps are wanted, usually ten, for each registration; reagent_result at any time after the source. What it
 * tells may go on to reagent_polish or reagent_verify, which say how sure the pose is.
 * Nothing is allocated and nothing is global: two memories are two independent users.
 */

#ifndef REAGENT_H
#define REAGENT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#if (defined(__x86_64__) || defined(__aarch64__))
// Words of a ReagentMemory.
#define REAGENT_MEMORY_WORDS 8128
#endif

#if !(defined(__x86_64__) || defined(__aarch64__))
// Words of a ReagentMemory.
#define REAGENT_MEMORY_WORDS 2048
#endif

// Words of a ReagentWorkspace.
#define REAGENT_WORKSPACE_WORDS 24700

// Version of this header: changes with incompatible calls.
#define REAGENT_VERSION_MAJOR 0

// Version of this header: changes with new calls (with incompatible ones, too, before 1.0.0).
#define REAGENT_VERSION_MINOR 1

// Version of this header: changes with nothing that a caller sees.
#define REAGENT_VERSION_PATCH 0

// Version of this header as one number, to compare with reagent_version.
#define REAGENT_VERSION (((REAGENT_VERSION_MAJOR * 1000000) + (REAGENT_VERSION_MINOR * 1000)) + REAGENT_VERSION_PATCH)

// What came of a call; reagent_status_text has a sentence for each. Whatever is not OK has changed nothing.
typedef enum {
  // Done.
  REAGENT_STATUS_OK = 0,
  // A pointer is null or not aligned.
  REAGENT_STATUS_POINTER = 1,
  // reagent_init has not succeeded on this memory.
  REAGENT_STATUS_NOT_INITIALISED = 2,
  // No target or no source has been set.
  REAGENT_STATUS_NOT_STARTED = 3,
  // The source, or the only cloud of the call, has no points.
  REAGENT_STATUS_EMPTY_CLOUD = 4,
  // The source, or the only cloud of the call, has fewer than 3 points.
  REAGENT_STATUS_TOO_FEW_POINTS = 5,
  // The source, or the only cloud of the call, has more than 4096 points.
  REAGENT_STATUS_TOO_MANY_POINTS = 6,
  // A coordinate of the source, of the only cloud of the call or of a grid is NaN or infinite.
  REAGENT_STATUS_NOT_FINITE = 7,
  // All points of the target coincide.
  REAGENT_STATUS_NO_EXTENT = 8,
  // The initial pose is not a finite rigid transform.
  REAGENT_STATUS_BAD_POSE = 9,
  // The weights are cut, or bytes follow their end.
  REAGENT_STATUS_WEIGHTS_LENGTH = 10,
  // The bytes are no weight file.
  REAGENT_STATUS_WEIGHTS_MAGIC = 11,
  // The weight file is of a version, number format or shape that this library does not run.
  REAGENT_STATUS_WEIGHTS_FORMAT = 12,
  // The weights are damaged.
  REAGENT_STATUS_WEIGHTS_DAMAGED = 13,
  // The weights do not start on a 4-byte boundary.
  REAGENT_STATUS_WEIGHTS_ALIGNMENT = 14,
  // Anything else.
  REAGENT_STATUS_OTHER = 15,
  // The target has no points.
  REAGENT_STATUS_TARGET_EMPTY = 16,
  // The target has fewer than 3 points.
  REAGENT_STATUS_TARGET_TOO_FEW_POINTS = 17,
  // The target has more than 4096 points.
  REAGENT_STATUS_TARGET_TOO_MANY_POINTS = 18,
  // A coordinate of the target is NaN or infinite.
  REAGENT_STATUS_TARGET_NOT_FINITE = 19,
} ReagentStatus;

// Where the codes of a cloud lie in space: code c of an axis stands for the coordinate origin + c * step.
// A cloud of codes takes half the memory of one of floats.
typedef struct {
  // Point of the codes 0, 0, 0.
  float origin[3];
  // Distance between neighbouring codes, the same along every axis.
  float step;
} ReagentGrid;

// Memory of one registrar: the caller's, of any content, where it likes. It must not be moved or
// copied between calls.
typedef struct {
  uint64_t words[REAGENT_MEMORY_WORDS];
} ReagentMemory;

// Memory of reagent_polish and reagent_verify: the caller's, of any content, for as long as the call.
typedef struct {
  uint64_t words[REAGENT_WORKSPACE_WORDS];
} ReagentWorkspace;

// A rigid transform that maps the source onto the target, as rows of [R | t], in the clouds' units.
typedef struct {
  // Three rows of four.
  float rows[3][4];
} ReagentPose;

// One step of a registration: ids 0 to 10 of the step table for x, y and z; 5 is "stop".
typedef struct {
  // Along the axes.
  uint8_t translation[3];
  // About the axes.
  uint8_t rotation[3];
} ReagentStep;

// Where a registration is.
typedef struct {
  // The pose so far.
  ReagentPose target_from_source;
  // Steps taken.
  uint32_t steps;
  // Further steps change nothing: the last was "stop" on every axis, in all the ways in which the policy looks.
  bool converged;
} ReagentResult;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// The finest grid whose codes cover the cloud: each coordinate comes back within about half of its step, which
// is 1/65534 of the longest side of the cloud's box.
//
// # Safety
// `xyz` points to 3 * `points` floats, `grid` to where the grid is to be put.
ReagentStatus reagent_grid_of(const float *xyz,
                              size_t points,
                              ReagentGrid *grid);

// Puts a cloud on a grid: the nearest codes of each point, `points` times three; beyond the grid its edge.
//
// # Safety
// `grid` points to a grid; `xyz` to 3 * `points` floats; `codes` to where as many codes are to be put, elsewhere.
ReagentStatus reagent_encode(const ReagentGrid *grid,
                             const float *xyz,
                             size_t points,
                             int16_t *codes);

// Checks a policy file (.rgw), which is read in place from then on, and makes the memory ready.
//
// # Safety
// `memory` points to a whole ReagentMemory; `weights` to `length` bytes that stay as they are for as
// long as the memory is used.
ReagentStatus reagent_init(ReagentMemory *memory,
                           const uint8_t *weights,
                           size_t length);

#if defined(REAGENT_PRETRAINED)
// The policy that ships with ReAgent in f32, for reagent_init; its bytes into `length`. Of a library built with
// the feature pretrained: define REAGENT_PRETRAINED.
//
// # Safety
// `length` points to a size, or is null.
const uint8_t *reagent_pretrained(size_t *length);
#endif

#if defined(REAGENT_PRETRAINED_INT8)
// The policy that ships with ReAgent in 8-bit integers, for reagent_init; its bytes into `length`. Of a
// library built with the feature pretrained-int8: define REAGENT_PRETRAINED_INT8.
//
// # Safety
// `length` points to a size, or is null.
const uint8_t *reagent_pretrained_int8(size_t *length);
#endif

#if defined(REAGENT_PRETRAINED_COMPACT)
// The policy for small microcontrollers, for reagent_init; its bytes into `length`. Of a library built with
// the feature pretrained-compact: define REAGENT_PRETRAINED_COMPACT.
//
// # Safety
// `length` points to a size, or is null.
const uint8_t *reagent_pretrained_compact(size_t *length);
#endif

// Makes a pose better by at most 22 robust steps of closest points, both ways; it fits no worse afterwards. Of
// more than 2048 points of a cloud so many are used. `probability` is where it is told how likely the pose is
// within 5 degrees and .05 radii of the right one, or null: below .5 it should not be trusted.
//
// # Safety
// `workspace` points to a whole ReagentWorkspace; `source` and `target` to 3 * as many floats as they have
// points; `pose` to a pose, where the better one is put; `probability` is null or points to a float.
ReagentStatus reagent_polish(ReagentWorkspace *workspace,
                             const float *source,
                             size_t source_points,
                             const float *target,
                             size_t target_points,
                             ReagentPose *pose,
                             float *probability);

// As reagent_polish, and compared with some four hundred other poses: the best one is taken, by how it fits and by how near to
// `pose` it is. That takes some six times as long.
//
// # Safety
// As reagent_polish.
ReagentStatus reagent_verify(ReagentWorkspace *workspace,
                             const float *source,
                             size_t source_points,
                             const float *target,
                             size_t target_points,
                             ReagentPose *pose,
                             float *probability);

// Sets the target, the model or reference cloud: `points` times x, y, z. It is read again when a
// source is set, and not after. A registration under way ends.
//
// # Safety
// `memory` is as reagent_init left it; `xyz` points to 3 * `points` floats that stay as they are
// until the last source is set.
ReagentStatus reagent_set_target(ReagentMemory *memory, const float *xyz, size_t points);

// As reagent_set_target, of a cloud on a grid: `points` times three codes.
//
// # Safety
// As reagent_set_target; `grid` points to a grid, which is copied, and `codes` to 3 * `points` codes.
ReagentStatus reagent_set_target_on_grid(ReagentMemory *memory,
                                         const ReagentGrid *grid,
                                         const int16_t *codes,
                                         size_t points);

// Sets the source, the observed cloud, in the target's units, and begins a registration: embeds the
// target, which takes as long as one step of as many points; reagent_begin leaves that to slices. `initial`
// is an estimate of the pose to find, null for none.
//
// # Safety
// As reagent_set_target, with `xyz` staying as it is until the last step; `initial` is null or points
// to a pose.
ReagentStatus reagent_set_source(ReagentMemory *memory,
                                 const float *xyz,
                                 size_t points,
                                 const ReagentPose *initial);

// As reagent_set_source, of a cloud on a grid; the target may be on another, or of floats.
//
// # Safety
// As reagent_set_source; `grid` points to a grid, which is copied, and `codes` to 3 * `points` codes.
ReagentStatus reagent_set_source_on_grid(ReagentMemory *memory,
                                         const ReagentGrid *grid,
                                         const int16_t *codes,
                                         size_t points,
                                         const ReagentPose *initial);

// As reagent_set_source, but only looks through the clouds: the slices of reagent_advance embed the target.
//
// # Safety
// As reagent_set_source; the target, too, stays as it is until the last step.
ReagentStatus reagent_begin(ReagentMemory *memory,
                            const float *xyz,
                            size_t points,
                            const ReagentPose *initial);

// As reagent_begin, of a cloud on a grid.
//
// # Safety
// As reagent_begin; `grid` points to a grid, which is copied, and `codes` to 3 * `points` codes.
ReagentStatus reagent_begin_on_grid(ReagentMemory *memory,
                                    const ReagentGrid *grid,
                                    const int16_t *codes,
                                    size_t points,
                                    const ReagentPose *initial);

// Does the next slice of the registration's work: looks at no more than `points` points (but at least one) of
// either cloud, or takes what was seen in, which is as much work as about 20 points are. `step` is where it is
// told what was done when that was a step, or null; `stepped` is where it is told whether it was one, or null.
// Steps and poses are the same to the bit, however they are sliced.
//
// # Safety
// `memory` is as reagent_begin or reagent_set_source left it; `step` is null or points to a step, `stepped` is
// null or points to a bool.
ReagentStatus reagent_advance(ReagentMemory *memory,
                              size_t points,
                              ReagentStep *step,
                              bool *stepped);

// Takes one step of the registration: looks at the source under the pose so far and moves it.
// `step` is where it is told what was done, or null.
//
// # Safety
// `memory` is as reagent_set_source left it; `step` is null or points to a step.
ReagentStatus reagent_step(ReagentMemory *memory, ReagentStep *step);

// Where the registration is.
//
// # Safety
// `memory` is as reagent_set_source left it; `result` points to a result.
ReagentStatus reagent_result(ReagentMemory *memory, ReagentResult *result);

// A sentence that says what a status means and what to do, in English; it lives as long as the program.
const char *reagent_status_text(int32_t status);

// Version of the library that is linked: REAGENT_VERSION of its own header.
uint32_t reagent_version(void);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* REAGENT_H */
