/* Palpate from C11, and from every language that calls C: how much of a rigid tool, filled with
 * spheres, lies in what depth cameras see, with force, torque, stiffness and clearance, and the
 * haptic loop on top (docs/guide/c.md).
 *
 * Objects are opaque handles, made by ..._create and its like and freed by ..._free, which takes
 * null. SI units; names carry frames: X_WT is the pose of the tool in the world. Poses map
 * coordinates, quaternions are x y z w. Structs that may grow begin with their size: set it to
 * sizeof. Options are texts, "contact.method = graph; contact.edges = cut", with the names of
 * docs/settings.md; null or "": the defaults.
 *
 * A function that can fail takes a palpate_error, which may be null, and returns null or
 * PALPATE_FAILED; the text is one sentence that says what failed, where, and what to do. It fails
 * without an object or a size that it needs; a function without errors then writes nothing. Nothing
 * is global. A handle is used by one thread at a time; tools by any number. An object that was made
 * with others or took them in (a contact its tool, a scene its sensors and bodies) must be freed
 * before them. */
#ifndef PALPATE_C_PALPATE_H
#define PALPATE_C_PALPATE_H

#include <stddef.h>
#include <stdint.h>
#if defined(__GNUC__)
#define PALPATE_C __attribute__((visibility("default")))
#else
#define PALPATE_C
#endif

#ifdef __cplusplus
extern "C" {
#endif
typedef struct palpate_tool palpate_tool;       /* a solid with its spheres; immutable */
typedef struct palpate_sensor palpate_sensor;   /* a depth camera with its two newest surfaces */
typedef struct palpate_scene palpate_scene;     /* cameras and bodies together */
typedef struct palpate_contact palpate_contact; /* measures one tool by one method */
typedef struct palpate_hand palpate_hand;       /* local contact, coupling and safety filter */
typedef struct palpate_simulation palpate_simulation; /* a simulated scene and its depth camera */
#define PALPATE_OK 0
#define PALPATE_FAILED (-1)
/* Kind of an error. */
enum {
  PALPATE_INVALID_ARGUMENT = 1, /* a parameter is out of its range */
  PALPATE_NOT_FOUND = 2,        /* there is no such shape or scene */
  PALPATE_BAD_INPUT = 3,        /* data was read and is not acceptable */
  PALPATE_IO_FAILURE = 4,
  PALPATE_UNAVAILABLE = 5, /* this build or machine cannot do it, or has too little memory */
  PALPATE_CANCELLED = 6    /* the caller's progress function requested a stop */
};
typedef struct palpate_error {
  int32_t code;   /* 0: none */
  char text[508]; /* one sentence, UTF-8, cut at the end if it is longer */
} palpate_error;
typedef struct palpate_pose {
  double translation[3]; /* m */
  double rotation[4];    /* unit quaternion x y z w */
} palpate_pose;
typedef struct palpate_wrench {
  double force[3];  /* N */
  double torque[3]; /* N m */
} palpate_wrench;

/* Returns the version, "1.2.3". */
PALPATE_C const char* palpate_version(void);
/* ---- Tools ---- */
/* Reports progress of a packing a few times per second: spheres so far, their share of the volume.
 * Returns 0 to cancel. */
typedef int (*palpate_progress)(void* context, int32_t num_spheres, double fill);

/* Packs a closed mesh with spheres: vertices x y z (m), triangles counter-clockwise seen from
 * outside. Options: packing. Repairs what it can; errors: not watertight (and where), cuts itself,
 * or a size that is no tool's. */
PALPATE_C palpate_tool* palpate_tool_pack(const double* vertices, size_t num_vertices,
                                          const uint32_t* triangles, size_t num_triangles,
                                          const char* options, palpate_progress progress,
                                          void* context, palpate_error* error);
/* Packs a shape by its name (stylus, finger, box, sphere, ...), `size` long (m). */
PALPATE_C palpate_tool* palpate_tool_pack_shape(const char* shape, double size, const char* options,
                                                palpate_error* error);
/* Reads a tool file from memory. */
PALPATE_C palpate_tool* palpate_tool_load(const void* bytes, size_t num_bytes,
                                          palpate_error* error);
/* Returns the number of bytes of the tool's file and writes them if they fit into `capacity`; 0:
 * error. */
PALPATE_C size_t palpate_tool_save(const palpate_tool* tool, void* bytes, size_t capacity,
                                   palpate_error* error);
/* Makes a coarser tool of the first spheres. */
PALPATE_C palpate_tool* palpate_tool_prefix(const palpate_tool* tool, int32_t num_spheres,
                                            palpate_error* error);
PALPATE_C void palpate_tool_free(palpate_tool* tool);

typedef struct palpate_tool_info {
  uint32_t size;
  int32_t num_spheres, num_vertices, num_triangles;
  double volume;            /* m3, of the solid */
  double center_of_mass[3]; /* m, of the spheres: reference point of all torques */
  double radius;            /* m, of a ball around it that contains the tool */
  double low[3], high[3];   /* m, box around the mesh */
} palpate_tool_info;
PALPATE_C void palpate_tool_describe(const palpate_tool* tool, palpate_tool_info* info);
/* Copies the spheres, x y z r in the tool's frame: room for 4 num_spheres. */
PALPATE_C void palpate_tool_spheres(const palpate_tool* tool, float* spheres);
/* Copies the mesh: room for 3 num_vertices and 3 num_triangles. Either may be null. */
PALPATE_C void palpate_tool_mesh(const palpate_tool* tool, float* vertices, uint32_t* triangles);

/* ---- Depth cameras ---- */
typedef struct palpate_camera {
  uint32_t size;
  int32_t width, height; /* pixels, 8 to 4096 */
  double fx, fy, cx, cy; /* pixels; centers are at integers */
  double distortion[8];  /* k1 k2 p1 p2 k3 k4 k5 k6 as in OpenCV; zeros: none */
} palpate_camera;

/* Makes a camera. Options: surface, field. `num_threads` 0: one per core. */
PALPATE_C palpate_sensor* palpate_sensor_create(const palpate_camera* camera, const char* options,
                                                int32_t num_threads, palpate_error* error);
PALPATE_C void palpate_sensor_free(palpate_sensor* sensor);
/* Computes the surface of an image: `unit` meters per count, 0: no measurement, 65535: farther.
 * X_WC: pose of the camera; null: W is the camera frame. */
PALPATE_C int palpate_sensor_update_counts(palpate_sensor* sensor, const uint16_t* counts,
                                           double unit, const palpate_pose* X_WC,
                                           palpate_error* error);
/* The same from meters: 0, NaN or less: no measurement, infinite: farther. */
PALPATE_C int palpate_sensor_update_meters(palpate_sensor* sensor, const float* meters,
                                           const palpate_pose* X_WC, palpate_error* error);

/* ---- Scenes ---- */
PALPATE_C palpate_scene* palpate_scene_create(palpate_error* error);
PALPATE_C void palpate_scene_free(palpate_scene* scene);
/* Adds a camera, at most 16. A second one needs sensors with options "field.unknown = ..." as
 * docs/guide says. */
PALPATE_C int palpate_scene_add_sensor(palpate_scene* scene, const palpate_sensor* sensor,
                                       palpate_error* error);
/* Adds a fixed body. Returns its number, from 0, or PALPATE_FAILED. */
PALPATE_C int32_t palpate_scene_add_body(palpate_scene* scene, const palpate_tool* shape,
                                         const palpate_pose* X_WB, palpate_error* error);
PALPATE_C int palpate_scene_move_body(palpate_scene* scene, int32_t body, const palpate_pose* X_WB,
                                      palpate_error* error);

/* ---- Measuring ---- */
/* Bits of palpate_measure.status. With those of PALPATE_UNMEASURED there is no measurement. */
enum {
  PALPATE_NON_FINITE_POSE = 1,
  PALPATE_AMBIGUOUS_NORMALS = 2,
  PALPATE_NO_SURFACE = 8,
  PALPATE_NO_EDGE_VECTORS = 16,
  PALPATE_OUTSIDE_WINDOW = 32,
  PALPATE_UNMEASURED = 1 | 4 | 8 | 32
};
/* Bits of palpate_measure.wants, by the method field only. */
enum { PALPATE_WANTS_STIFFNESS = 1, PALPATE_WANTS_SIGMA = 2 };

/* The measure at one pose. Volume times direction: times N/m3 it is a wrench, about the tool's
 * center of mass, in W. */
typedef struct palpate_measure {
  uint32_t size;
  uint32_t wants;  /* in: PALPATE_WANTS_ bits; out: those that the method has */
  double progress; /* in: from the surfaces before the newest (0) to the newest (1) */
  uint8_t* states; /* in: null, or num_spheres: 0 outside, 1 boundary, 2 inside */
  float* planes;   /* in: null, or 4 num_spheres: n x y z, d; n x <= d is inside; n = 0: none */
  uint32_t status; /* bits */
  int32_t num_boundary, num_inside;
  double volume;          /* m3 */
  double potential;       /* m4 */
  double force[3];        /* m3 */
  double torque[3];       /* m4 */
  double stiffness[36];   /* minus the derivative of (force, torque) by (shift, turn), rows first */
  double volume_sigma;    /* m3, standard deviations by the noise of the cameras; NaN: unknown */
  double force_sigma[3];  /* m3 */
  double torque_sigma[3]; /* m4 */
  double moments[9];      /* with the stiffness: sum of levers times forces, m4 */
  double polar_moment, bodies_volume; /* m5; m3: the share of bodies in the volume */
} palpate_measure;

/* Makes a contact. Options: contact. `num_threads` 0: one per core. */
PALPATE_C palpate_contact* palpate_contact_create(const palpate_tool* tool, const char* options,
                                                  int32_t num_threads, palpate_error* error);
PALPATE_C void palpate_contact_free(palpate_contact* contact);
/* Measures one pose. */
PALPATE_C int palpate_contact_measure(palpate_contact* contact, const palpate_scene* scene,
                                      const palpate_pose* X_WT, palpate_measure* measure,
                                      palpate_error* error);

/* Arrays of the caller for P poses, row by row; null: not computed. */
typedef struct palpate_answers {
  uint32_t size;
  double* volume;             /* P, m3 */
  double* potential;          /* P, m4 */
  double* force;              /* P x 3, m3 */
  double* torque;             /* P x 3, m4 */
  double* stiffness;          /* P x 36 */
  uint32_t* status;           /* P */
  double* volume_sigma;       /* P */
  double* force_sigma;        /* P x 3 */
  double* torque_sigma;       /* P x 3 */
  double* unseen;             /* P: share of the volume where no camera has seen */
  double clearance_limit;     /* m; 0: 0.1 */
  double* clearance;          /* P, m: distance to the nearest thing, negative inside */
  int32_t* nearest;           /* P: its sphere; -1: beyond the limit */
  double* clearance_gradient; /* P x 6 */
  float* sphere_depth;        /* P x num_spheres, m */
  float* sphere_volume;       /* P x num_spheres, m3 */
  float* sphere_direction;    /* P x num_spheres x 3 */
} palpate_answers;
/* Measures many poses. */
PALPATE_C int palpate_contact_measure_many(palpate_contact* contact, const palpate_scene* scene,
                                           const palpate_pose* X_WT, size_t num_poses,
                                           const palpate_answers* answers, palpate_error* error);
/* Writes 1 for each pose that is nearer to anything than `margin` (m), else 0. */
PALPATE_C int palpate_contact_any(palpate_contact* contact, const palpate_scene* scene,
                                  const palpate_pose* X_WT, size_t num_poses, double margin,
                                  uint8_t* hits, palpate_error* error);

/* ---- The haptic loop ---- */
/* Safe limits of a device; 0: it renders none. */
typedef struct palpate_device {
  uint32_t size;
  double max_force, max_torque;                /* N, N m */
  double max_stiffness, max_angular_stiffness; /* N/m, N m/rad */
  double max_damping;                          /* N s/m */
  double workspace_radius;                     /* m */
  double damping, angular_damping;             /* N s/m, N m s/rad, of the mechanism */
  double rate;                                 /* ticks per second */
} palpate_device;

/* Makes the loop of a device that holds a tool. Options: coupling, friction, texture, safety. */
PALPATE_C palpate_hand* palpate_hand_create(const palpate_tool* tool, const palpate_device* device,
                                            const char* options, palpate_error* error);
PALPATE_C void palpate_hand_free(palpate_hand* hand);
/* Takes the newest measure, at time (s), of a frame that was captured at `captured` (s). */
PALPATE_C void palpate_hand_contact(palpate_hand* hand, const palpate_measure* measure,
                                    const palpate_pose* X_WT, double time, double captured);

/* The state of the device at a tick: base frame B x right, y up, z toward the hand; handle H. */
typedef struct palpate_handle {
  uint32_t size;
  uint32_t buttons;    /* a bit for each */
  double time;         /* s, monotonic */
  palpate_pose X_BH;   /* of the handle */
  double linear[3];    /* m/s */
  double angular[3];   /* rad/s */
  int32_t is_valid;    /* 0: the device sent nothing usable */
  int32_t wants_force; /* 1: the force shall return, also in contact */
  int32_t is_released; /* 1: no hand is there: no force */
  int32_t is_stopping; /* 1: the force fades for good */
} palpate_handle;
typedef struct palpate_tick {
  uint32_t size;
  int32_t state;            /* 0 waiting, 1 engaged, 2 fading, 3 off, 4 held off, 5 ended */
  palpate_wrench F_H_B;     /* safe wrench on the hand, at the handle, in B */
  palpate_wrench contact_W; /* contact and friction on the tool, about its center of mass, in W */
  palpate_pose X_WT;        /* of the simulated tool */
  palpate_pose X_WT_hand;   /* of the tool as the hand would hold it */
  double stretch;           /* m, between the two */
  double energy;            /* J, net energy that the hand was given */
  double gain;              /* 0 to 1, ramp or fade */
  int32_t fault;            /* why there is no force; 0: none */
  int32_t num_faults;
} palpate_tick;
/* Computes one tick: no allocation, no lock. */
PALPATE_C void palpate_hand_tick(palpate_hand* hand, const palpate_handle* handle,
                                 palpate_tick* tick);
/* Changes options between ticks, as palpate_hand_create takes them; the tool stays where it is. The
 * safety filter stays. */
PALPATE_C int palpate_hand_change(palpate_hand* hand, const char* options, palpate_error* error);
/* Computes the pose of the handle that holds the tool at X_WT. */
PALPATE_C void palpate_hand_handle_at(const palpate_hand* hand, const palpate_pose* X_WT,
                                      palpate_pose* X_BH);
/* Returns what a fault means and what to do, in one sentence. */
PALPATE_C const char* palpate_fault_text(int32_t fault);

/* ---- Simulated scenes ---- */
typedef struct palpate_simulation_info {
  uint32_t size;
  palpate_camera camera;
  double unit, rate, duration; /* m per count, frames per second, s */
  double tool_size;            /* m, of the shape that goes with it */
  char tool_shape[24], title[200];
} palpate_simulation_info;

/* Returns the names of all scenes, separated by commas. */
PALPATE_C const char* palpate_simulation_names(void);
/* Makes a simulated scene. The image is `width` wide. `noise` 1: that of a structured-light camera;
 * 0: none. The same `seed` gives the same frames. */
PALPATE_C palpate_simulation* palpate_simulation_create(const char* scene, int32_t width,
                                                        int32_t height, double noise, uint64_t seed,
                                                        palpate_error* error);
PALPATE_C void palpate_simulation_free(palpate_simulation* simulation);
PALPATE_C void palpate_simulation_describe(const palpate_simulation* simulation,
                                           palpate_simulation_info* info);
/* Takes the next frame: counts, its time (s) and its pose of the camera, which may be null. Begins
 * anew after the last. */
PALPATE_C int palpate_simulation_next(palpate_simulation* simulation, uint16_t* counts,
                                      double* time, palpate_pose* X_WC, palpate_error* error);
/* Computes the pose of the tool on the scene's own path, at a time (s). */
PALPATE_C void palpate_simulation_tool_at(const palpate_simulation* simulation, double time,
                                          palpate_pose* X_WT);

#ifdef __cplusplus
}
#endif
#endif /* PALPATE_C_PALPATE_H */
