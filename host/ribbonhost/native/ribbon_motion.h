/* Motion of a sensor ribbon without a gyroscope: orientation, angular rate and angular acceleration along the
 * ribbon from specific force and magnetic field. The whole interface of the C motion estimator.
 *
 * The ribbon is a rod that bends about its binormal and twists about its tangent. Its state is the
 * orientation at the anchor, the coefficients of twist and bending on cubic B-splines along the ribbon, the
 * first two time derivatives of both, and the anchor's position, velocity and acceleration. docs/motion.md
 * derives the equations.
 *
 * For every function:
 *  1. Structures are the caller's memory, hold no pointers, and may be copied as they are. Nothing is
 *     allocated or shared: any number of threads may call with different structures.
 *  2. SI units; the field in microtesla; vectors of the world frame are ENU; q turns node vectors into world
 *     vectors, Hamilton, scalar first.
 *  3. The result is zero or positive, or a negative `enum ribbon_motion_error`; after an error the outputs
 *     hold nothing of use.
 *  4. Pointers must not be null unless said otherwise.
 */
#ifndef RIBBON_MOTION_H
#define RIBBON_MOTION_H

#include <stddef.h>
#include <stdint.h>

enum ribbon_motion_error {
    RIBBON_MOTION_ERROR_COUNT = -1,      /* a count is outside the limits below */
    RIBBON_MOTION_ERROR_PARAMETER = -2,  /* a parameter is not finite or not positive */
    RIBBON_MOTION_ERROR_NOT_FINITE = -3, /* a covariance is not positive definite */
    RIBBON_MOTION_ERROR_TIME = -4,       /* a sample is not later than the one before */
    RIBBON_MOTION_ERROR_NO_NODE = -5     /* no node is valid where at least two are needed */
};

enum ribbon_motion_limit {
    RIBBON_MOTION_NODE_MIN = 6,
    RIBBON_MOTION_NODE_MAX = 32,
    RIBBON_MOTION_SLOT_MAX = 64, /* two a node */
    RIBBON_MOTION_TWIST_MAX = 16,
    RIBBON_MOTION_BEND_MAX = 18,
    RIBBON_MOTION_BLOCK_MAX = 37,    /* anchor rotation, twist, bending */
    RIBBON_MOTION_OFFSET_SHAPES = 6, /* polynomials along the ribbon */
    RIBBON_MOTION_OFFSETS = 18,      /* of each axis of the node frame */
    RIBBON_MOTION_STATE_MAX = 138,   /* three blocks, the offsets, nine of the anchor's place */
    RIBBON_MOTION_MATRIX_MAX = 144   /* rows and columns that a matrix of the states has in memory */
};

/* What has a jerk of its own: each axis of the anchor's rotation in its frame, twist, bending. */
enum ribbon_motion_jerk {
    RIBBON_MOTION_JERK_ROOT = 0,
    RIBBON_MOTION_JERK_TWIST = 3,
    RIBBON_MOTION_JERK_BEND = 4,
    RIBBON_MOTION_JERK_COUNT = 5
};

/* How a ribbon is built, how well it measures, and how it may move. */
struct ribbon_motion_params {
    size_t nodes;        /* orientations; accelerometers at slots 0, 2, ..., magnetometers at 1, 3, ... */
    double pitch_m;      /* between neighbouring slots */
    double gravity_mps2; /* specific force at rest */
    double field_ut[3];  /* local field, world */
    int field_axes;      /* that a magnetometer has: 3, or 2 */
    double field_normal[RIBBON_MOTION_NODE_MAX][3]; /* node frame: along it one of two axes feels nothing */
    double accel_sigma_mps2; /* noise of one axis and sample, leftover calibration included */
    double field_sigma_ut;
    double
        force_overlap; /* samples over which an accelerometer averages, at least 1: their noise is shared */
    double force_jitter_s; /* standard deviation of the instants at which the accelerometers sample */
    double field_later_s;  /* by which the magnetometers sample later than the accelerometers on average */
    /* Square root of the spectral density of the white third derivative: how fast it may change its ways. */
    double root_jerk;            /* of the anchor's rotation, rad/s^3 a root hertz */
    double twist_jerk;           /* of the twist, rad/m/s^3 a root hertz */
    double bend_jerk;            /* of the curvature, 1/m/s^3 a root hertz */
    double persistence_s;        /* how long a rate or an acceleration lasts by itself */
    double offset_persistence_s; /* how long what calibration left of an accelerometer's error lasts */
    double anchor_sigma_mps2;    /* standard deviation of the anchor's acceleration when it moves by itself */
    double anchor_low_hz, anchor_high_hz; /* the band it lies in */
};

/* What follows from the parameters alone. */
struct ribbon_motion_model {
    struct ribbon_motion_params params;
    size_t slots, modes, twist_modes, block, states;
    /* Integral of each mode over the segment between slots i and i + 1, and its first moment about the
     * middle in units of the pitch. */
    double segment[RIBBON_MOTION_SLOT_MAX][RIBBON_MOTION_BLOCK_MAX];
    double moment[RIBBON_MOTION_SLOT_MAX][RIBBON_MOTION_BLOCK_MAX];
    double offset_shape[RIBBON_MOTION_OFFSET_SHAPES][RIBBON_MOTION_NODE_MAX]; /* orthonormal polynomials */
    double field_frame[RIBBON_MOTION_NODE_MAX][9]; /* magnetometer, its z along the normal, from node */
    double anchor_rate[3];          /* coefficients of the anchor's third-order process, see docs/motion.md */
    double anchor_covariance[3][3]; /* stationary, one axis: position, velocity, acceleration */
};

/* An estimate at one moment. The error of the state has the order: block (rotation of the anchor as a world
 * vector, twist, bending); its rate and its acceleration (angular ones in the anchor's frame); the anchor's
 * position and velocity in the world, and the specific force there in its own frame. So a rotation about the
 * field is seen by no magnetometer, and none at all by the accelerometers, wherever the state is: a filter
 * would otherwise learn from rounding the corner what it cannot know. */
struct ribbon_motion_state {
    double t_s;
    double root[9];                    /* orientation at the anchor, row-major, world from node */
    double known_mps2[3];              /* part of the anchor's acceleration that is known, world */
    double x[RIBBON_MOTION_STATE_MAX]; /* the error's order; entries 0 to 2 are unused */
};

/* One scan. Values of a sensor that is not valid are not read; one with a value that is not finite counts as
 * not valid. */
struct ribbon_motion_sample {
    double t_s;
    double force_mps2[RIBBON_MOTION_NODE_MAX][3]; /* calibrated specific force, node frame */
    double
        force_change_mps3[RIBBON_MOTION_NODE_MAX]; /* magnitude of its rate of change, roughly; see jitter */
    double field_ut[RIBBON_MOTION_NODE_MAX][3];    /* calibrated field, node frame; with two axes, along the
                                                      normal it may be anything finite */
    uint8_t force_valid[RIBBON_MOTION_NODE_MAX];
    uint8_t field_valid[RIBBON_MOTION_NODE_MAX];
    double anchor_mps2[3]; /* known acceleration of the anchor, world: that of the reference ribbon */
    double level_q[RIBBON_MOTION_NODE_MAX][4]; /* level reading, to start from and to fall back to */
    uint8_t level_valid[RIBBON_MOTION_NODE_MAX];
    uint8_t level_still; /* the device says that nothing moves: then its level reading is a mean over time */
};

/* What a tracker does with a sample. */
enum ribbon_motion_status {
    RIBBON_MOTION_WAITING = 0,  /* nothing is known yet: no level reading to start from */
    RIBBON_MOTION_STARTED = 1,  /* from the level reading of this sample, for the first time or again */
    RIBBON_MOTION_SETTLING = 2, /* started less than a third of a second ago */
    RIBBON_MOTION_TRACKING = 3
};

/* What one sample leaves behind: all that a smoother needs of it. */
struct ribbon_motion_step {
    struct ribbon_motion_state state;     /* estimate from all samples so far */
    struct ribbon_motion_state predicted; /* from the samples before */
    double covariance[RIBBON_MOTION_MATRIX_MAX][RIBBON_MOTION_MATRIX_MAX]; /* of state */
    double predicted_covariance[RIBBON_MOTION_MATRIX_MAX][RIBBON_MOTION_MATRIX_MAX];
    int32_t status; /* enum ribbon_motion_status */
};

/* Variances as they are found to be, in units of those that the parameters say. */
struct ribbon_motion_scales {
    double force_noise;                    /* of the accelerometers */
    double field_noise;                    /* of the magnetometers */
    double force_offset;                   /* of what lasts in the accelerometers' errors */
    double jerk[RIBBON_MOTION_JERK_COUNT]; /* of enum ribbon_motion_jerk */
    double anchor;                         /* of the anchor's acceleration */
    double slack_mps2;                     /* standard deviation added to the accelerometers' noise */
};

/* How a sample fitted what was predicted. Outliers are sensors further off than the gate. */
struct ribbon_motion_fit {
    double force_innovation, field_innovation; /* normalised and squared, a degree of freedom: near 1 */
    double force_residual,
        field_residual;       /* what the corrected state leaves unexplained, the same: their noise */
    double anchor_correction; /* squared correction of its acceleration, in units of the one expected */
    /* Corrections of the accelerations of the first block, and the variances expected of them. */
    double correction[RIBBON_MOTION_BLOCK_MAX], correction_variance[RIBBON_MOTION_BLOCK_MAX];
    double anchor_score; /* test for an acceleration of the anchor at this instant, a degree of freedom */
    double force_left[RIBBON_MOTION_NODE_MAX]
                     [3];          /* residuals of the accelerometers, frame of the anchor; NaN */
    size_t forces, force_outliers; /* accelerometers that were valid, and of them outliers */
    size_t fields, field_outliers; /* magnetometers */
};

struct ribbon_motion_work;

/* Memory of struct ribbon_motion_work, aligned as a double. Its content means nothing between calls. */
size_t ribbon_motion_work_bytes(void);

/* Estimates of all nodes at one moment; positions, velocities and accelerations are relative to the anchor,
 * in the directions of the world. */
struct ribbon_motion_nodes {
    double t_s;
    double q[RIBBON_MOTION_NODE_MAX][4];
    double position_m[RIBBON_MOTION_NODE_MAX][3];
    double velocity_mps[RIBBON_MOTION_NODE_MAX][3];
    double acceleration_mps2[RIBBON_MOTION_NODE_MAX][3];
    double rate_radps[RIBBON_MOTION_NODE_MAX][3]; /* angular velocity, world */
    double sigma_rad[RIBBON_MOTION_NODE_MAX];     /* of the orientation, largest axis */
    double position_covariance_m2[RIBBON_MOTION_NODE_MAX][3][3];
    double anchor_acceleration_mps2[3];
};

/* Fills *model, or returns RIBBON_MOTION_ERROR_COUNT or _PARAMETER. */
int ribbon_motion_model_init(struct ribbon_motion_model *model, const struct ribbon_motion_params *params);

/* A state at the sample's time that has the shape of the level reading and does not move, with a covariance
 * that allows for a reading taken in motion. Returns 0, or RIBBON_MOTION_ERROR_NO_NODE if fewer than two
 * nodes have a valid level reading. */
int ribbon_motion_from_level(const struct ribbon_motion_model *model,
                             const struct ribbon_motion_sample *sample,
                             const struct ribbon_motion_scales *scales, struct ribbon_motion_step *step,
                             struct ribbon_motion_work *work);

/* Uses the sample at which `step` stands: corrects step->predicted with it, which the caller, or
 * ribbon_motion_advance, has put there together with its covariance, and fills state, covariance and *fit.
 *  1. around: where to linearise; null: at the prediction, again at the result if that lies far.
 *  2. Sensors whose innovation exceeds what its covariance explains (squared norm over the gate, 30) get the
 *     weight that brings them back to it.
 *  3. Returns 0, or RIBBON_MOTION_ERROR_NOT_FINITE if the covariance has lost its sense: then state and
 *     covariance are those of the prediction. */
int ribbon_motion_correct(const struct ribbon_motion_model *model, const struct ribbon_motion_sample *sample,
                          const struct ribbon_motion_state *around, const struct ribbon_motion_scales *scales,
                          struct ribbon_motion_step *step, struct ribbon_motion_fit *fit,
                          struct ribbon_motion_work *work);

/* Predicts from the state of `before` to the time of the sample: fills what is predicted of `step`, which may
 * be `before` itself. Returns 0, or RIBBON_MOTION_ERROR_TIME if the sample is not later. */
int ribbon_motion_advance(const struct ribbon_motion_model *model, const struct ribbon_motion_sample *sample,
                          const struct ribbon_motion_scales *scales, const struct ribbon_motion_step *before,
                          struct ribbon_motion_step *step);

/* Fixed-interval smoothing (Rauch, Tung, Striebel) of `count` steps, from the last to the first; a step whose
 * status is RIBBON_MOTION_STARTED learns nothing for those before it.
 *  1. states: (count). nodes: (node_count) of the first of them, with covariances from all that follow up to
 *     `ahead` steps after the last of these: some thirty later ones hardly matter.
 *  2. Steps whose status is RIBBON_MOTION_WAITING hold nothing, and their states neither; their nodes are
 * left alone. */
void ribbon_motion_smooth(const struct ribbon_motion_model *model, size_t count,
                          const struct ribbon_motion_step *steps, struct ribbon_motion_state *states,
                          struct ribbon_motion_nodes *nodes, size_t node_count, size_t ahead,
                          struct ribbon_motion_work *work);

/* Nodes of a state. covariance: of the state, null: sigma_rad and position_covariance_m2 become NaN. */
void ribbon_motion_output(const struct ribbon_motion_model *model, const struct ribbon_motion_state *state,
                          const double covariance[RIBBON_MOTION_MATRIX_MAX][RIBBON_MOTION_MATRIX_MAX],
                          struct ribbon_motion_nodes *nodes, struct ribbon_motion_work *work);

/* Follows one ribbon from sample to sample: starts by itself, judges its own health, starts again when lost,
 * and finds out whether the anchor moves. */
struct ribbon_motion_tracker {
    struct ribbon_motion_model model;
    int status;                  /* enum ribbon_motion_status of the last sample */
    double start_s;              /* time of the last start */
    double unsure_s;             /* time of the last start or shock */
    double ill_s;                /* for how long the samples have not fitted */
    double misfit, field_misfit; /* innovations of the last fraction of a second, running means */
    double jerk_test[RIBBON_MOTION_JERK_COUNT]; /* squares of the corrections in units of those expected */
    /* Sums of the corrections of the last fraction of a second, and the variances expected of them. */
    double drift[RIBBON_MOTION_BLOCK_MAX], drift_variance[RIBBON_MOTION_BLOCK_MAX];
    double field_outlying; /* share of the magnetometers that are outliers, running mean */
    double force_left[RIBBON_MOTION_NODE_MAX][3]; /* residuals of the sample before */
    double left_square, left_change;              /* of them and of their change, running means */
    double anchor_correction;                     /* the same of the anchor's acceleration */
    double anchor_power; /* mean square of the anchor's acceleration, units of its greatest variance */
    double anchor_test;  /* how strongly the samples ask for an anchor that moves more: near 1 if not */
    struct ribbon_motion_scales scales; /* found from the samples */
    int32_t has_learnt;                 /* scales are those of an earlier pass: the next start keeps them */
    uint64_t samples, restarts, outliers, rejected; /* counts; rejected: samples out of order */
    struct ribbon_motion_fit fit;                   /* of the last sample */
};

/* Returns 0, or RIBBON_MOTION_ERROR_COUNT or _PARAMETER. */
int ribbon_motion_tracker_init(struct ribbon_motion_tracker *tracker,
                               const struct ribbon_motion_params *params);

/* Makes the tracker ready to begin again, with what it has learnt of the sensors and of the motion. */
void ribbon_motion_tracker_rewind(struct ribbon_motion_tracker *tracker);

/* Takes the tracker from `before` (null at first) over one sample to `after`, which must be another.
 *  1. Returns the status; after RIBBON_MOTION_STARTED `before` has no part in `after`, after
 *     RIBBON_MOTION_WAITING `after` holds nothing.
 *  2. A sample that is not later than `before` changes nothing but a count and returns
 *     RIBBON_MOTION_ERROR_TIME. */
int ribbon_motion_track(struct ribbon_motion_tracker *tracker, const struct ribbon_motion_sample *sample,
                        const struct ribbon_motion_step *before, struct ribbon_motion_step *after,
                        struct ribbon_motion_work *work);

/* Tracks `count` samples, later and later; steps: (count + 1), of which the first holds what the tracker left
 * before, or a status of RIBBON_MOTION_WAITING; step i + 1 belongs to sample i.
 * Returns 0, or RIBBON_MOTION_ERROR_TIME before anything is done. */
int ribbon_motion_run(struct ribbon_motion_tracker *tracker, size_t count,
                      const struct ribbon_motion_sample *samples, struct ribbon_motion_step *steps,
                      struct ribbon_motion_work *work);

/* Nodes of the states of `count` steps, not smoothed. Those of a waiting step hold nothing. */
void ribbon_motion_step_outputs(const struct ribbon_motion_model *model, size_t count,
                                const struct ribbon_motion_step *steps, struct ribbon_motion_nodes *nodes,
                                struct ribbon_motion_work *work);

#endif
