/*
 * ReAgent point cloud registration. Made by cbindgen from core/capi/src/lib.rs: do not edit.
 *
 * Order of calls: reagent_init once; reagent_set_target, reagent_set_source and then reagent_step as often
 * as steps are wanted, usually ten, for each registration; reagent_result at any time after the source.
 * Nothing is allocated and nothing is global: two memories are two independent users.
 */

#ifndef REAGENT_H
#define REAGENT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#if (defined(__x86_64__) || defined(__aarch64__))
// Words of a ReagentMemory.
#define REAGENT_MEMORY_WORDS 6400
#endif

#if !(defined(__x86_64__) || defined(__aarch64__))
// Words of a ReagentMemory.
#define REAGENT_MEMORY_WORDS 1920
#endif

// What came of a call. Whatever is not OK has changed nothing.
typedef enum {
  // Done.
  REAGENT_STATUS_OK = 0,
  // A pointer is null or not aligned.
  REAGENT_STATUS_POINTER = 1,
  // reagent_init has not succeeded on this memory.
  REAGENT_STATUS_NOT_INITIALISED = 2,
  // No target or no source has been set.
  REAGENT_STATUS_NOT_STARTED = 3,
  // A cloud has no points.
  REAGENT_STATUS_EMPTY_CLOUD = 4,
  // A cloud has fewer than 3 points.
  REAGENT_STATUS_TOO_FEW_POINTS = 5,
  // A cloud has more than 4096 points.
  REAGENT_STATUS_TOO_MANY_POINTS = 6,
  // A coordinate is NaN or infinite.
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
} ReagentStatus;

// Memory of one registrar: the caller's, of any content, where it likes. It must not be moved or
// copied between calls.
typedef struct {
  uint64_t words[REAGENT_MEMORY_WORDS];
} ReagentMemory;

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
  // The last step was "stop" on every axis: further ones change nothing.
  bool converged;
} ReagentResult;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// Checks a policy file (.rgw), which is read in place from then on, and makes the memory ready.
//
// # Safety
// `memory` points to a whole ReagentMemory; `weights` to `length` bytes that stay as they are for as
// long as the memory is used.
ReagentStatus reagent_init(ReagentMemory *memory,
                           const uint8_t *weights,
                           size_t length);

// Sets the target, the model or reference cloud: `points` times x, y, z. It is read again when a
// source is set, and not after. A registration under way ends.
//
// # Safety
// `memory` is as reagent_init left it; `xyz` points to 3 * `points` floats that stay as they are
// until the last source is set.
ReagentStatus reagent_set_target(ReagentMemory *memory, const float *xyz, size_t points);

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

// As reagent_set_source, but only looks through the clouds: the slices of reagent_advance embed the target.
//
// # Safety
// As reagent_set_source; the target, too, stays as it is until the last step.
ReagentStatus reagent_begin(ReagentMemory *memory,
                            const float *xyz,
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

// Where the registration is.
//
// # Safety
// `memory` is as reagent_set_source left it; `result` points to a result.
ReagentStatus reagent_result(ReagentMemory *memory, ReagentResult *result);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* REAGENT_H */
