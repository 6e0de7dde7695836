/*
 * ReAgent point cloud registration. Made by cbindgen from core/capi/src: do not edit.
 *
 * Order of calls: reagent_init once; then reagent_register for each registration. Or step by step: reagent_set_target,
 * reagent_set_source and then reagent_step as often as steps are wanted, usually ten; reagent_result at any time after the
 * source. What it tells may go on to reagent_refine, which says how sure the pose is.
 * Nothing is allocated and nothing is global: two memories are two independent users.
 */

#ifndef REAGENT_H
#define REAGENT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

// Most poses that an answer lists as fitting equally well.
#define REAGENT_OTHERS 5

#if !defined(__arm__)
// Words of a ReagentMemory.
#define REAGENT_MEMORY_WORDS 8128
#endif

#if defined(__arm__)
// Words of a ReagentMemory.
#define REAGENT_MEMORY_WORDS 2240
#endif

// Words of a ReagentModel.
#define REAGENT_MODEL_WORDS 14500

// Major version of this header: changes with incompatible calls.
#define REAGENT_VERSION_MAJOR 0

// Minor version of this header: changes with new calls, and before 1.0.0 with incompatible ones.
#define REAGENT_VERSION_MINOR 1

// Patch version of this header: changes with nothing that a caller sees.
#define REAGENT_VERSION_PATCH 0

// Version of this header as one number, to compare with reagent_version.
#define REAGENT_VERSION (((REAGENT_VERSION_MAJOR * 1000000) + (REAGENT_VERSION_MINOR * 1000)) + REAGENT_VERSION_PATCH)

// Words of a ReagentWorkspace.
#define REAGENT_WORKSPACE_WORDS 30300

// Outcome of a call; reagent_status_text has a sentence for each. A call that is not OK changed nothing, except that
// reagent_prepare leaves the model unprepared.
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
  // A coordinate of the source, of the only cloud of the call, of a grid or of an origin is NaN, infinite or beyond 1e12.
  REAGENT_STATUS_NOT_FINITE = 7,
  // All points of a cloud coincide, or the target's points nearly do.
  REAGENT_STATUS_NO_EXTENT = 8,
  // The initial pose is not a rigid transform, or its translation is beyond 1e12.
  REAGENT_STATUS_BAD_POSE = 9,
  // The weights are cut short, or bytes follow their end.
  REAGENT_STATUS_WEIGHTS_LENGTH = 10,
  // The bytes are not a weight file.
  REAGENT_STATUS_WEIGHTS_MAGIC = 11,
  // The weight file has a version, number format or shape that this library does not run.
  REAGENT_STATUS_WEIGHTS_FORMAT = 12,
  // The weights are damaged.
  REAGENT_STATUS_WEIGHTS_DAMAGED = 13,
  // The weights do not start on a 4-byte boundary.
  REAGENT_STATUS_WEIGHTS_ALIGNMENT = 14,
  // Any other error.
  REAGENT_STATUS_OTHER = 15,
  // The target has no points.
  REAGENT_STATUS_TARGET_EMPTY = 16,
  // The target has fewer than 3 points.
  REAGENT_STATUS_TARGET_TOO_FEW_POINTS = 17,
  // The target has more than 4096 points.
  REAGENT_STATUS_TARGET_TOO_MANY_POINTS = 18,
  // A coordinate of the target is NaN, infinite or beyond 1e12.
  REAGENT_STATUS_TARGET_NOT_FINITE = 19,
  // A coordinate of the view point is NaN, infinite or beyond 1e12.
  REAGENT_STATUS_BAD_VIEW_POINT = 20,
  // A standard deviation of the start is negative or NaN.
  REAGENT_STATUS_BAD_UNCERTAINTY = 21,
  // The task's mode is not a ReagentMode.
  REAGENT_STATUS_NO_SUCH_MODE = 22,
  // reagent_prepare has not succeeded on the task's model.
  REAGENT_STATUS_NOT_PREPARED = 23,
  // The task's background has more than 4096 points.
  REAGENT_STATUS_BACKGROUND_TOO_MANY_POINTS = 24,
  // The step of a grid is 0 or negative.
  REAGENT_STATUS_BAD_GRID = 25,
  // The task has outward directions, but not one for each point of the target.
  REAGENT_STATUS_OUTWARD_COUNT = 26,
  // A depth image has no pixels, or its camera's focal lengths are not positive or a number of it is not finite.
  REAGENT_STATUS_BAD_CAMERA = 27,
} ReagentStatus;

// What can be said about a pose.
typedef enum {
  // The clouds fit so well that the pose is probably right; without refinement: the policy saw nothing left to correct.
  REAGENT_VERDICT_CONVERGED = 0,
  // The steps ran out while the policy still moved, or nothing was done.
  REAGENT_VERDICT_STEP_LIMIT = 1,
  // The steps ran out while the policy went back and forth.
  REAGENT_VERDICT_OSCILLATING = 2,
  // The steps ran out while the policy still took the largest steps: the pose is farther away than the steps reach.
  REAGENT_VERDICT_OUT_OF_RANGE = 3,
  // The clouds do not fit: the pose is probably wrong.
  REAGENT_VERDICT_POOR_FIT = 4,
  // One cloud is several times as large as the other, by extents_ratio; perhaps inches against millimetres.
  REAGENT_VERDICT_SIZES_DIFFER = 5,
  // One cloud has too few distinct points for any pose to be trusted.
  REAGENT_VERDICT_TOO_FEW_POINTS = 6,
  // The mirror image of the source fits better: a left-hand part for a
  // right-hand one, a reversed axis, or a wrong pose of a symmetric shape.
  REAGENT_VERDICT_MIRRORED = 7,
} ReagentVerdict;

// How much work a registration does.
typedef enum {
  // The policy's steps alone, as the paper has it.
  REAGENT_MODE_FAST = 0,
  // The policy's steps, then a few robust steps of closest points.
  REAGENT_MODE_POLISH = 1,
  // As POLISH, then a comparison with one to eight hundred other poses. The best is taken, judged by its fit and its distance
  // from the start. This takes some six times as long.
  REAGENT_MODE_VERIFY = 2,
  // A few robust steps of closest points from the start, without the policy: for tracking.
  REAGENT_MODE_REFINE = 3,
} ReagentMode;

// Where the codes of a cloud lie in space: code c on an axis stands for the coordinate origin + c * step. A cloud of codes
// takes half the memory of a cloud of floats.
typedef struct {
  // Point of the codes (0, 0, 0).
  float origin[3];
  // Distance between neighbouring codes, the same along every axis.
  float step;
} ReagentGrid;

// A pinhole camera without distortion; all in pixels.
typedef struct {
  // Focal length across.
  float fx;
  // Focal length down.
  float fy;
  // Column of the optical axis, from 0 at the first pixel's centre.
  float cx;
  // Row of the optical axis.
  float cy;
} ReagentCamera;

// A rigid transform that maps the source onto the target, as rows of [R | t], in the clouds' units.
typedef struct {
  // Three rows of four.
  float rows[3][4];
} ReagentPose;

// Memory of one registrar, provided by the caller, with any content. It must not be moved or copied between calls.
typedef struct {
  uint64_t words[REAGENT_MEMORY_WORDS];
} ReagentMemory;

// A target prepared by reagent_prepare. It may be moved and copied, and any number of registrations may use it at a time.
typedef struct {
  uint64_t words[REAGENT_MODEL_WORDS];
} ReagentModel;

// Memory for one call of reagent_register, reagent_refine or reagent_prepare, provided by the caller, with any content.
typedef struct {
  uint64_t words[REAGENT_WORKSPACE_WORDS];
} ReagentWorkspace;

// What to do with two clouds: reagent_task makes a default one, in which fields may be changed.
typedef struct {
  // A ReagentMode.
  int32_t mode;
  // Most steps of the policy; 10 in the paper.
  uint32_t steps;
  // An estimate of the pose.
  ReagentPose start;
  // If not 0, all rotations are as probable as the estimate's.
  uint32_t anywhere;
  // Standard deviation of the estimate's rotation about the object's centre, in radians.
  float rotation_rad;
  // Standard deviation of the object's centre along the viewing axis, in target radii.
  float along;
  // The same across the axis. Without a view point, the larger of the two holds in all directions.
  float across;
  // Where the sensor stood: x, y and z in the source's frame and unit, if the source is a view from one point; else null.
  const float *view_point;
  // What the sensor saw besides the source, such as the other pixels of a depth image: x, y and z of each point, in the
  // source's frame and unit. What would stand in front of it counts against a pose as well. NaN and infinite points are
  // ignored. Null if unknown; ignored without a view point.
  const float *background;
  // Number of these points, at most 4096: pixels spread around the object are enough.
  size_t background_points;
  // Which way the target's surface faces, as a closed mesh tells: x, y and z of a direction for each point of the target,
  // in their order. What faces away from the sensor was not seen. Three times INFINITY at a point that nothing outside can
  // see, such as one inside a housing. Null if unknown; ignored without a view point, and for a target of more than 2048
  // points.
  const float *outward;
  // Number of these directions: that of the target's points, or 0.
  size_t outward_directions;
  // The target, prepared by reagent_prepare; null if it is not. A model of another target is ignored.
  const ReagentModel *model;
} ReagentTask;

// The pose, and what can be said about it. All but pose, verdict and steps describe a refined pose; in mode FAST they are 0.
typedef struct {
  // The pose.
  ReagentPose target_from_source;
  // What can be said about it.
  ReagentVerdict verdict;
  // Number of steps that the policy took.
  uint32_t steps;
  // Whether the pose was refined.
  bool refined;
  // Probability that the pose is within 5 degrees and .05 target radii of the truth, or not to be told from it (ADI below
  // .02 diameters), up to what is undetermined; 0 in mode FAST, else at most .9999.
  float probability;
  // Share of the source's points that lie on the target's surface.
  float overlap;
  // RMS distance of those points from it, in the clouds' unit.
  float inlier_rmse;
  // Size of the source over that of the target.
  float extents_ratio;
  // Distinct points of the cloud that has fewer of them.
  uint32_t distinct_points;
  // Shares of the source's and of the target's points left out because they lie far from all others.
  float left_out[2];
  // Share of the target's points behind which something was seen, so that they cannot be there; 0 where nothing
  // besides the source was seen.
  float seen_through;
  // Whether the clouds fit as well turned about an axis. Modes POLISH and REFINE look for it
  // only where the surface hardly holds it; in mode FAST it is false.
  bool axis_is_open;
  // A point of the axis, in the target's frame and unit.
  float axis_point[3];
  // Unit vector along the axis.
  float axis_direction[3];
  // Smallest (not positive) and largest (not negative) right-handed turn about it at which they fit as well, in radians.
  float axis_range_rad[2];
  // Whether the clouds fit as well shifted along a direction. Only
  // mode VERIFY looks for it: in other modes it is always false.
  bool slide_is_open;
  // Unit vector along that direction, in the target's frame.
  float slide_direction[3];
  // Smallest (not positive) and largest (not negative) shift along it that fit as well, in the target's unit.
  float slide_range[2];
  // Whether the axis may have any direction, since the target is a ball.
  bool any_rotation;
  // Not 0: turned about another axis by any multiple of a full turn over this number, the clouds fit as well, as a flange with
  // six holes does for 6. Only mode VERIFY looks for it: in other modes it is always 0.
  uint32_t fold_order;
  // A point of that axis, in the target's frame and unit.
  float fold_point[3];
  // Unit vector along it.
  float fold_direction[3];
  // How many other poses are listed that fit as well, fewer than there are if there are more than REAGENT_OTHERS.
  // Only mode VERIFY looks for them: in the other modes it is always 0.
  uint32_t others;
  // The other poses, those first that the fold makes of the given one.
  ReagentPose other_poses[REAGENT_OTHERS];
  // Covariance of the pose's error if it is the right pose: of a rotation vector in radians,
  // then of a translation in the clouds' unit, both along the target's axes. A point that
  // the pose puts at x, the truth puts at c + exp(rotation) (x - c) + translation.
  float covariance[6][6];
  // The point c: the target's centroid, or the point of an open axis nearest to it.
  float covariance_about[3];
} ReagentAnswer;

// One step of a registration: ids into the step table, 0 to 10, for x, y and z; 5 is "stop".
typedef struct {
  // Ids along the axes.
  uint8_t translation[3];
  // Ids about the axes.
  uint8_t rotation[3];
} ReagentStep;

// State of a registration.
typedef struct {
  // The pose so far.
  ReagentPose target_from_source;
  // Steps taken.
  uint32_t steps;
  // Whether further steps would change nothing: the last was "stop"
  // on every axis, in all the ways in which the policy looks.
  bool converged;
} ReagentResult;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// Reorders a cloud in place so that neighbours follow each other: on a microcontroller, registering ordered clouds takes half
// the instructions. Order the model once, and a cloud on a grid before it is encoded. At most 4096 points. NaN stays in the
// cloud, which is refused later.
//
// # Safety
// `xyz` points to 3 * `points` floats.
ReagentStatus reagent_put_in_order(float *xyz,
                                   size_t points);

// Finds the finest grid whose codes cover the cloud. Each coordinate comes back within about half its step, which is 1/65534
// of the longest side of the cloud's box.
//
// # Safety
// `xyz` points to 3 * `points` floats, `grid` to room for a grid.
ReagentStatus reagent_grid_of(const float *xyz,
                              size_t points,
                              ReagentGrid *grid);

// Puts a cloud on a grid: writes the nearest codes of each point, `points` times three; points beyond the grid get its edge.
// The grid's step must be positive.
//
// # Safety
// `grid` points to a grid, `xyz` to 3 * `points` floats, and `codes` to room for as many codes, elsewhere.
ReagentStatus reagent_encode(const ReagentGrid *grid,
                             const float *xyz,
                             size_t points,
                             int16_t *codes);

// Turns a depth image into points in the camera's frame (x to the right, y down, z ahead) and in the depths' unit: a source, whose
// view point is then 0, 0, 0; or with `inside` 0 what the camera saw besides, a task's background. If more than `capacity` pixels
// have a depth, as many of them are taken, evenly. Depths that are NaN, infinite, 0 or negative are none. `count` receives the number of
// points.
//
// # Safety
// `depth` points to `width` * `height` floats, row by row; `mask` is null, for the whole image, or points to as many bytes, not 0
// where the image shows the object; `camera` points to a camera, `points` to room for 3 * `capacity` floats, `count` to a size.
ReagentStatus reagent_points_of_depth(const float *depth,
                                      size_t width,
                                      size_t height,
                                      const ReagentCamera *camera,
                                      const uint8_t *mask,
                                      uint32_t inside,
                                      float *points,
                                      size_t capacity,
                                      size_t *count);

// Subtracts an origin from a cloud of doubles, so that floats keep its digits. The origin is the median of some points; `near`
// receives `points` times x, y and z relative to it, at most 4096 points. Each cloud has its own origin; reagent_far_pose
// converts poses between such clouds back.
//
// # Safety
// `xyz` points to 3 * `points` doubles, `origin` to room for three, `near` to room for 3 * `points` floats.
ReagentStatus reagent_take_origin_off(const double *xyz,
                                      size_t points,
                                      double *origin,
                                      float *near);

// Converts a pose between clouds whose origins were subtracted to one between the original doubles, as rows of [R | t].
//
// # Safety
// `near` points to a pose, each origin to three doubles, `rows` to room for twelve.
ReagentStatus reagent_far_pose(const ReagentPose *near,
                               const double *source_origin,
                               const double *target_origin,
                               double *rows);

// The inverse of reagent_far_pose: gives a start for ReagentTask from a pose between the original doubles.
//
// # Safety
// `rows` points to twelve doubles, each origin to three, `near` to room for a pose.
ReagentStatus reagent_near_pose(const double *rows,
                                const double *source_origin,
                                const double *target_origin,
                                ReagentPose *near);

// Checks a policy file (.rgw), which is read in place from then on, and prepares the memory.
//
// # Safety
// `memory` points to a whole ReagentMemory, and `weights` to `length` bytes that stay unchanged as long as the memory is used.
ReagentStatus reagent_init(ReagentMemory *memory,
                           const uint8_t *weights,
                           size_t length);

// Prepares a target once for any number of registrations: a ReagentTask may refer to the model. A target of more than 2048
// points is prepared by every registration nevertheless.
//
// # Safety
// `model` and `workspace` point to a whole ReagentModel and ReagentWorkspace, of any content; `target` to 3 * `target_points` floats.
ReagentStatus reagent_prepare(ReagentModel *model,
                              ReagentWorkspace *workspace,
                              const float *target,
                              size_t target_points);

#if defined(REAGENT_PRETRAINED)
// The policy that ships with ReAgent in f32, for reagent_init; writes its length in bytes to `length`. Needs a library built
// with the feature pretrained: define REAGENT_PRETRAINED.
//
// # Safety
// `length` points to a size, or is null.
const uint8_t *reagent_pretrained(size_t *length);
#endif

#if defined(REAGENT_PRETRAINED_INT8)
// The policy that ships with ReAgent in 8-bit integers, for reagent_init; writes its length in bytes to `length`. Needs a
// library built with the feature pretrained-int8: define REAGENT_PRETRAINED_INT8.
//
// # Safety
// `length` points to a size, or is null.
const uint8_t *reagent_pretrained_int8(size_t *length);
#endif

#if defined(REAGENT_PRETRAINED_COMPACT)
// The policy for small microcontrollers, for reagent_init; writes its length in bytes to `length`. Needs a library built with
// the feature pretrained-compact: define REAGENT_PRETRAINED_COMPACT.
//
// # Safety
// `length` points to a size, or is null.
const uint8_t *reagent_pretrained_compact(size_t *length);
#endif

#if defined(REAGENT_PRETRAINED_VIEWS)
// The policy for single depth views in 8-bit integers, for reagent_init; writes its length in bytes to `length`. Needs a
// library built with the feature pretrained-views: define REAGENT_PRETRAINED_VIEWS.
//
// # Safety
// `length` points to a size, or is null.
const uint8_t *reagent_pretrained_views_int8(size_t *length);
#endif

#if defined(REAGENT_PRETRAINED_VIEWS_COMPACT)
// The policy for single depth views on small microcontrollers, for reagent_init; writes its length in bytes to `length`. Needs
// a library built with the feature pretrained-views-compact: define REAGENT_PRETRAINED_VIEWS_COMPACT.
//
// # Safety
// `length` points to a size, or is null.
const uint8_t *reagent_pretrained_views_compact(size_t *length);
#endif

// Runs a whole registration: the policy's steps, then the refinement of the task's mode. The refinement uses at most 2048
// points of each cloud. A registration in progress in the memory ends.
//
// # Safety
// `memory` is as reagent_init left it; `workspace` points to a whole ReagentWorkspace; `source` and `target` to 3 floats for
// each of their points; `task` to a task; `answer` to room for an answer.
ReagentStatus reagent_register(ReagentMemory *memory,
                               ReagentWorkspace *workspace,
                               const float *source,
                               size_t source_points,
                               const float *target,
                               size_t target_points,
                               const ReagentTask *task,
                               ReagentAnswer *answer);

// Refines a pose, perhaps reached by reagent_step, as the task's mode says: no policy is needed. The start counts as evidence,
// but the refinement does not begin there.
//
// # Safety
// As reagent_register; `reached` points to a pose.
ReagentStatus reagent_refine(ReagentWorkspace *workspace,
                             const float *source,
                             size_t source_points,
                             const float *target,
                             size_t target_points,
                             const ReagentPose *reached,
                             const ReagentTask *task,
                             ReagentAnswer *answer);

// Sets the target, the model or reference cloud: `points` times x, y, z. It is read again when a source is set, but not later.
// A registration in progress ends.
//
// # Safety
// `memory` is as reagent_init left it; `xyz` points to 3 * `points` floats that stay unchanged until the last source is set.
ReagentStatus reagent_set_target(ReagentMemory *memory,
                                 const float *xyz,
                                 size_t points);

// As reagent_set_target, for a cloud on a grid: `points` times three codes.
//
// # Safety
// As reagent_set_target; `grid` points to a grid, which is copied, and `codes` to 3 * `points` codes.
ReagentStatus reagent_set_target_on_grid(ReagentMemory *memory,
                                         const ReagentGrid *grid,
                                         const int16_t *codes,
                                         size_t points);

// Sets the source, the observed cloud, in the target's units, and starts a registration.
// This embeds the target, which takes as long as one step over as many points;
// reagent_begin leaves that to slices. `initial` is an estimate of the pose, null for none.
//
// # Safety
// As reagent_set_target, but `xyz` stays unchanged until the last step; `initial` is null or points to a pose.
ReagentStatus reagent_set_source(ReagentMemory *memory,
                                 const float *xyz,
                                 size_t points,
                                 const ReagentPose *initial);

// As reagent_set_source, for a cloud on a grid; the target may be on another grid, or of floats.
//
// # Safety
// As reagent_set_source; `grid` points to a grid, which is copied, and `codes` to 3 * `points` codes.
ReagentStatus reagent_set_source_on_grid(ReagentMemory *memory,
                                         const ReagentGrid *grid,
                                         const int16_t *codes,
                                         size_t points,
                                         const ReagentPose *initial);

// As reagent_set_source, but only checks the clouds; the slices of reagent_advance embed the target.
//
// # Safety
// As reagent_set_source; the target, too, stays unchanged until the last step.
ReagentStatus reagent_begin(ReagentMemory *memory,
                            const float *xyz,
                            size_t points,
                            const ReagentPose *initial);

// As reagent_begin, for a cloud on a grid.
//
// # Safety
// As reagent_begin; `grid` points to a grid, which is copied, and `codes` to 3 * `points` codes.
ReagentStatus reagent_begin_on_grid(ReagentMemory *memory,
                                    const ReagentGrid *grid,
                                    const int16_t *codes,
                                    size_t points,
                                    const ReagentPose *initial);

// Does the next slice of the registration's work: looks at `points` points at most (but at least one) of either cloud; or runs
// a head on what was seen, which costs at most as many multiply-adds as 9 points, or 17 if the policy looks both ways. If that
// completes a step, writes what was done to `step`, unless null; writes whether it does to `stepped`, unless null. Steps and
// poses are the same to the bit, however they are sliced.
//
// # Safety
// `memory` is as reagent_begin or reagent_set_source left it; `step` is null or points to a step, `stepped` is null or points
// to a bool.
ReagentStatus reagent_advance(ReagentMemory *memory,
                              size_t points,
                              ReagentStep *step,
                              bool *stepped);

// Takes one step of the registration: looks at the source under the
// present pose and moves it. Writes what was done to `step`, unless null.
//
// # Safety
// `memory` is as reagent_set_source left it; `step` is null or points to a step.
ReagentStatus reagent_step(ReagentMemory *memory, ReagentStep *step);

// Writes the state of the registration to `result`.
//
// # Safety
// `memory` is as reagent_set_source left it; `result` points to a result.
ReagentStatus reagent_result(ReagentMemory *memory, ReagentResult *result);

// An English sentence that says what a status means and what to do; it lives as long as the program.
const char *reagent_status_text(int32_t status);

// A task for the best pose within the paper's ten steps, from the identity, with the default uncertainty.
ReagentTask reagent_task(void);

// Version of the linked library: REAGENT_VERSION of its own header.
uint32_t reagent_version(void);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* REAGENT_H */
