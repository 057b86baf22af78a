/* halflight: natural light for scalar volumes, in Vulkan compute.
 *
 *   volume + transfer function -> field (who sees how much of the sky)      hl_precompute
 *   field + light + camera     -> image (linear radiance, premultiplied)    hl_render
 *
 * Calls.    Every call returns HL_OK or another hl_status; the sentence to a negative one: hl_last_error. A call that
 *           fails creates nothing and sets the handles that it was to give to NULL. Nothing here exits, aborts or prints.
 * Structs.  HL_INIT first: struct_size is the sizeof the struct, any other member 0 means its default. Later versions
 *           append members: a longer struct than the library knows is taken if the rest is zero, a shorter one as
 *           if its missing members were 0. No struct_size ends within a pointer or number; what is `reserved` must be 0.
 * Handles.  NULL, destroyed and foreign ones give HL_ERROR_HANDLE; destroying NULL does nothing. What a thing was made
 *           from may be destroyed before it. hl_engine_destroy stops the engine's jobs and destroys all that was made from it.
 * Threads.  Any call, from any thread. Engines know nothing of each other. Calls that need one engine's device run one
 *           after the other; a running job lets them in between two dispatches (about 0.1 s). Calls on jobs, on
 *           finished images, and hl_last_error never wait for the device.
 * Jobs.     What a running job (or blocking call) reads cannot be changed meanwhile: HL_ERROR_BUSY. It can be destroyed.
 * Callbacks run on the thread of the call or of the job. Within one, of the same engine only hl_job_poll, _cancel,
 *           _timing, _get_field, _get_image, _get_estimate and hl_last_error work (and hl_job_wait of 0 seconds, a look);
 *           all else on it returns HL_ERROR_REENTRANT. Other engines may be used. None may throw an exception or longjmp out:
 *           either would end the process.
 * Units.    World coordinates are the data's own units; voxel i covers i..i+1. Radiance is linear RGB. Angles: degrees.
 *
 * C99 or C++. Layouts are those of the platform's C ABI; HL_ABI counts incompatible changes of them. */
#ifndef HALFLIGHT_H
#define HALFLIGHT_H

#include <stdint.h>
#include <string.h>

#ifdef __cplusplus
extern "C" {
#endif

#define HL_VERSION_MAJOR 0
#define HL_VERSION_MINOR 1
#define HL_VERSION_PATCH 0
#define HL_ABI 0 /* as in libhalflight.so.0 */

typedef struct hl_engine hl_engine;     /* a Vulkan device with the kernels on it */
typedef struct hl_volume hl_volume;     /* scalar samples on a grid */
typedef struct hl_transfer hl_transfer; /* scalar -> colour and opacity */
typedef struct hl_light hl_light;       /* distant light */
typedef struct hl_field hl_field;       /* visibility of a volume under a transfer function */
typedef struct hl_image hl_image;       /* pixels in host memory */
typedef struct hl_job hl_job;           /* work under way */

/* ---- Status ---------------------------------------------------------------------------------------------------- */

typedef int32_t hl_status;
#define HL_OK 0
#define HL_NOT_READY 1           /* no error: there is no result yet */
#define HL_TIMEOUT 2             /* no error: the job still runs */
#define HL_END 3                 /* no error: no more entries */
#define HL_ERROR_INVALID -1      /* a value is out of its range; a NULL that must not be */
#define HL_ERROR_HANDLE -2       /* a handle is NULL, destroyed, or of another kind or engine */
#define HL_ERROR_BUSY -3         /* a running job reads it */
#define HL_ERROR_REENTRANT -4    /* not from within a callback of this engine */
#define HL_ERROR_CANCELLED -5
#define HL_ERROR_NO_DEVICE -6    /* no Vulkan device, or none of that name */
#define HL_ERROR_DEVICE_LACKS -7 /* the device cannot run the kernels */
#define HL_ERROR_DEVICE_LOST -8  /* destroy the engine and make another */
#define HL_ERROR_MEMORY -9       /* more memory than allowed or there is */
#define HL_ERROR_IO -10          /* the system refused to read or write a file */
#define HL_ERROR_FORMAT -11      /* a file is damaged or of a kind that is not read */
#define HL_ERROR_POISONED -12    /* a defect was hit on this engine earlier, which the sentence names: only destroying works */
#define HL_ERROR_INTERNAL -13    /* a defect of the library */

/* Version of the library that runs, and its HL_ABI. Any pointer may be NULL. */
hl_status hl_version(uint32_t *major, uint32_t *minor, uint32_t *patch, uint32_t *abi);

/* The name of a status, such as "HL_ERROR_BUSY"; static. Of a number that is none: HL_ERROR_INVALID, and NULL for a name. */
hl_status hl_status_name(hl_status status, const char **name);

/* Status and sentence of this thread's last failed call on the engine (on any engine, or none, with NULL). Copies at most
 * `size` bytes with a final 0; `text` may be NULL. Returns HL_OK and "" where nothing failed. */
hl_status hl_last_error(const hl_engine *engine, char *text, uint64_t size);

/* What every struct with a size begins with. `next`: NULL, or an extension that the call knows by its struct_type. */
typedef struct hl_header {
    uint32_t struct_size;
    int32_t struct_type; /* 0, or HL_STRUCT_... of an extension */
    const void *next;
} hl_header;

/* Zeroes a struct and sets its size: all defaults. */
#define HL_INIT(s) (memset(&(s), 0, sizeof(s)), (s).struct_size = (uint32_t)sizeof(s))

/* ---- Engine ---------------------------------------------------------------------------------------------------- */

#define HL_LOG_ERROR 1 /* also what the validation layers say */
#define HL_LOG_WARNING 2
#define HL_LOG_INFO 3
#define HL_LOG_DEBUG 4
typedef void (*hl_log_fn)(void *user, int32_t severity, const char *text);

typedef struct hl_engine_info {
    uint32_t struct_size;
    int32_t struct_type;
    const void *next;           /* hl_vulkan_device: use that device of the host's */
    const char *device;         /* index, uuid or part of the name; NULL: the fastest kind */
    const char *pipeline_cache; /* folder; NULL: the user's cache folder; "": none */
    uint64_t memory;            /* bytes of device memory that may be held; 0: most of what there is. Small buffers come
                                 * out of blocks of 64 MiB, which are not counted where they are not full */
    hl_log_fn log;
    void *log_user;
    int32_t log_level; /* HL_LOG_...; 0: warnings and errors */
    int32_t validate;  /* 1: Khronos validation layers, with synchronization */
    uint32_t threads;  /* of a CPU device; only while the process has one thread. 0: all */
    int32_t reserved;
} hl_engine_info;

typedef struct hl_device_info {
    uint32_t struct_size;
    int32_t struct_type;
    const void *next;
    char name[256];
    char driver[256];
    char uuid[40];
    int32_t kind; /* 0 discrete, 1 integrated, 2 virtual, 3 CPU, 4 other */
    uint32_t vulkan_major, vulkan_minor;
    uint32_t validation_errors; /* that the layers have reported */
    uint64_t memory_used, memory_peak, memory_budget; /* bytes held by this engine */
} hl_device_info;

/* The index-th device of this machine, as hl_engine_info.device counts them, without an engine on it; memory_budget is that
 * of its largest heap. HL_END after the last. */
hl_status hl_device_get(uint32_t index, hl_device_info *info);

hl_status hl_engine_create(const hl_engine_info *info, hl_engine **engine); /* info may be NULL */
hl_status hl_engine_destroy(hl_engine *engine);
hl_status hl_engine_get_device(const hl_engine *engine, hl_device_info *info);

/* ---- Volume ---------------------------------------------------------------------------------------------------- */

#define HL_UINT8 1 /* 8- and 16-bit integers stay exact, all others become 32-bit floats */
#define HL_INT8 2
#define HL_UINT16 3
#define HL_INT16 4
#define HL_UINT32 5
#define HL_INT32 6
#define HL_UINT64 7
#define HL_INT64 8
#define HL_FLOAT32 9
#define HL_FLOAT64 10

#define HL_COPY 0   /* the data are copied before the call returns */
#define HL_BORROW 1 /* they stay the caller's, valid and unchanged until `release` is called, exactly once (not at all if the
                       call fails). A volume is read at creation, and again by plans, error measurements, histograms and
                       hl_field_load; an image whenever it is used. */
typedef void (*hl_release_fn)(void *user, const void *data);

typedef struct hl_volume_info {
    uint32_t struct_size;
    int32_t struct_type;
    const void *next; /* hl_vulkan_image or hl_vulkan_buffer: samples on the host's device. Of the rest then only dims, place, slope
                         and intercept may be set, and the type of a buffer's samples */
    const void *data; /* sample (0, 0, 0); NULL with `next` */
    uint32_t dims[3]; /* samples along x, y, z */
    int32_t type;
    int64_t strides[3]; /* bytes from a sample to the next along x, y, z; may be negative; all 0: packed, x fastest */
    double spacing[3];  /* edges of a voxel; all 0: 1 */
    double axes[9];     /* world directions of x, y, z, one after the other; all 0: the world's own. Their lengths multiply the
                           spacing: give unit vectors, or the edges themselves and no spacing */
    double origin[3];   /* world position of voxel (0, 0, 0)'s outer corner */
    float slope;        /* value = slope * sample + intercept; slope 0: 1 */
    float intercept;
    int32_t replace_nan; /* 1: nan_as stands for samples that are not finite; 0: they are an error */
    float nan_as;
    int32_t memory; /* HL_COPY, HL_BORROW */
    int32_t reserved;
    hl_release_fn release; /* called from whichever call lets go last; may be NULL */
    void *release_user;
    uint32_t components; /* numbers that lie side by side at each voxel, of which one is the sample; 0: 1 */
    uint32_t component;  /* which, from 0; `data` is the first of voxel (0, 0, 0), packed strides are all components' */
} hl_volume_info;

typedef struct hl_load_info {
    uint32_t struct_size;
    int32_t struct_type;
    const void *next;
    const char *component; /* name, or number from 0, of the scalar in a file of several; NULL: the only one */
    const char *series;    /* SeriesInstanceUID, in a folder of several DICOM series */
    double spacing[3];     /* of a stack of pictures; all 0: as its files say, else 1 */
    int32_t replace_nan;   /* as in hl_volume_info */
    float nan_as;
} hl_load_info;

hl_status hl_volume_create(hl_engine *engine, const hl_volume_info *info, hl_volume **volume);
/* Any file with a header, folder or stack that the command reads. info may be NULL. */
hl_status hl_volume_load(hl_engine *engine, const char *path, const hl_load_info *info, hl_volume **volume);
hl_status hl_volume_destroy(hl_volume *volume);
hl_status hl_volume_get_range(const hl_volume *volume, uint32_t dims[3], double range[2]);
/* Its dims, place, slope and intercept, and the type that it has become; all else is 0. */
hl_status hl_volume_get_info(const hl_volume *volume, hl_volume_info *info);
/* Voxels per 64th of the range, and the mean value. */
hl_status hl_volume_get_histogram(const hl_volume *volume, uint64_t bins[64], double *mean);

/* ---- Transfer function ----------------------------------------------------------------------------------------- */

#define HL_OPACITY 0    /* 0..1 over the reference length */
#define HL_EXTINCTION 1 /* per reference length */

#define HL_PER_VOXEL 0 /* the reference length: smallest distance of neighbouring planes of voxels */
#define HL_PER_WORLD 1 /* one world unit */
#define HL_PER_SIDE 2  /* the volume's longest side */

typedef struct hl_transfer_info {
    uint32_t struct_size;
    int32_t struct_type;
    const void *next;
    const double *points; /* scalar, R, G, B (albedo, linear), opacity of each, ascending; NULL: a grey ramp over the data */
    uint32_t count;       /* of points: 5 * count numbers */
    int32_t kind;         /* HL_OPACITY, HL_EXTINCTION */
    int32_t reference;    /* HL_PER_... */
    int32_t reserved;
} hl_transfer_info;

typedef struct hl_transfer_file_info {
    uint32_t struct_size;
    int32_t struct_type;
    const void *next;
    const char *name; /* of the preset, in a file of several; NULL: the only one */
    double range[2];  /* scalars that its ends are laid on; both 0: as it says, which may be the volume's range */
    int32_t reference;
    int32_t reserved;
} hl_transfer_file_info;

hl_status hl_transfer_create(hl_engine *engine, const hl_transfer_info *info, hl_transfer **transfer); /* info may be NULL */
/* A preset of ParaView, Slicer, Voreen, Inviwo, ImageVis3D, NiiVue or Exposure Render. info may be NULL. */
hl_status hl_transfer_load(hl_engine *engine, const char *path, const hl_transfer_file_info *info, hl_transfer **transfer);
hl_status hl_transfer_guess(const hl_volume *volume, hl_transfer **transfer); /* by its histogram: to begin with */
hl_status hl_transfer_set(hl_transfer *transfer, const hl_transfer_info *info); /* for later precomputes */
hl_status hl_transfer_destroy(hl_transfer *transfer);

/* ---- Light ----------------------------------------------------------------------------------------------------- */

#define HL_LIGHT_WHITE 0
#define HL_LIGHT_CONSTANT 1    /* radiance from everywhere */
#define HL_LIGHT_DIRECTIONAL 2 /* radiance is the irradiance of a surface that faces it */
#define HL_LIGHT_CONE 3        /* radiance within half_angle of toward */
#define HL_LIGHT_PROBE 4       /* lat-long image, 2:1; top row +z, left edge +y, a quarter further +x */
#define HL_LIGHT_SH 5          /* 16 x RGB coefficients, index l(l+1)+m, orthonormal, signs as in Sloan 2008 */

#define HL_WINDOW_NONE 0
#define HL_WINDOW_HANNING 1
#define HL_WINDOW_LANCZOS 2
#define HL_WINDOW_GAUSS 3

typedef struct hl_light_info {
    uint32_t struct_size;
    int32_t struct_type;
    const void *next;
    int32_t kind;
    int32_t bands;        /* harmonics of the light that are used, 1 to 4; 0: 4 */
    int32_t window;       /* against ringing */
    float radiance[3];    /* constant, directional, cone */
    double toward[3];     /* directional, cone: to the light */
    double half_angle;    /* cone */
    hl_image *probe;      /* probe; copied */
    const double *coefficients; /* SH: 48 numbers */
    double scale;         /* of all radiance; 0: 1 */
    double axis[3];       /* turns the light about a world axis... */
    double degrees;       /* ...counter-clockwise, seen against it */
} hl_light_info;

hl_status hl_light_create(hl_engine *engine, const hl_light_info *info, hl_light **light); /* info may be NULL */
hl_status hl_light_set(hl_light *light, const hl_light_info *info);
hl_status hl_light_rotate(hl_light *light, const double axis[3], double degrees); /* replaces the earlier turn */
hl_status hl_light_get_coefficients(const hl_light *light, double coefficients[48]);
hl_status hl_light_destroy(hl_light *light);

/* ---- Image ----------------------------------------------------------------------------------------------------- */

#define HL_RGBA32F 0 /* linear, premultiplied; top row first */
#define HL_RGB32F 1  /* linear; as input coverage is 1 */
#define HL_RGBA8 2   /* for display: sRGB, clamped, not premultiplied */

typedef struct hl_image_info {
    uint32_t struct_size;
    int32_t struct_type;
    const void *next;
    const void *data; /* top left pixel */
    uint32_t width, height;
    int32_t format;
    int32_t memory;                      /* HL_COPY, HL_BORROW */
    int64_t column_stride, row_stride;   /* bytes; may be negative; 0: packed, rows downwards */
    hl_release_fn release;
    void *release_user;
} hl_image_info;

/* What lies behind the pixels of a picture, if hl_render_info.layers asked for it; numbers a pixel. Means are weighted by what
 * each place adds to the opacity. */
#define HL_LAYER_DEPTH 1u       /* 2: mean distance from the camera; the first at opacity 0.05. Infinite: nothing is there */
#define HL_LAYER_NORMAL 2u      /* 3: mean normal, world, brought to length 1 */
#define HL_LAYER_ALBEDO 4u      /* 3 */
#define HL_LAYER_IRRADIANCE 8u  /* 3: radiance at albedo 1 */
#define HL_LAYER_VISIBILITY 16u /* 1: of the sky, 0..1 */
#define HL_LAYER_OPACITY 32u    /* 1 */
#define HL_LAYER_NOISE 64u      /* 3: standard error of R, G, B. Reference pictures have it unasked, and no other layer */

#define HL_COMPRESSION_ZIP 0
#define HL_COMPRESSION_NONE 1
#define HL_COMPRESSION_RLE 2
#define HL_COMPRESSION_ZIPS 3
#define HL_COMPRESSION_PIZ 4

typedef struct hl_save_info {
    uint32_t struct_size;
    int32_t struct_type;
    const void *next;
    double exposure;     /* stops, of a .png */
    uint32_t layers;     /* sum of HL_LAYER_... that an .exr gets beside the colours */
    int32_t half;        /* 1: 16-bit floats in an .exr, but for distances */
    int32_t compression; /* of an .exr; all are lossless */
    int32_t reserved;
} hl_save_info;

#define HL_DIFFERENCE_SIGNED 0 /* a - b */
#define HL_DIFFERENCE_FLIP 1   /* FLIP's map, in colours */

typedef struct hl_difference {
    uint32_t struct_size;
    int32_t struct_type;
    const void *next;
    double relative_rmse; /* sqrt(mean((a - b)^2)) / mean(b) over what b covers; negative where that is nothing or black */
    double mean_ratio;    /* mean(a) / mean(b); negative as above */
    double largest;       /* of |a - b| */
    double flip_mean;     /* perceived difference, 0..1 (FLIP; HDR-FLIP for radiance beyond 1) */
} hl_difference;

hl_status hl_image_create(hl_engine *engine, const hl_image_info *info, hl_image **image);
hl_status hl_image_load(hl_engine *engine, const char *path, hl_image **image); /* OpenEXR, Radiance HDR, PNG */
hl_status hl_image_destroy(hl_image *image);
hl_status hl_image_get_size(const hl_image *image, uint32_t *width, uint32_t *height);
/* Copies the pixels. `data`: where the top left one goes; row_stride 0: packed, negative: rows lie upwards in memory, bottom row
 * first, with `data` in the last; `size`: bytes of all rows with what lies between. Exposure in stops, of HL_RGBA8 only. */
hl_status hl_image_read(const hl_image *image, int32_t format, double exposure, void *data, int64_t row_stride, uint64_t size);
/* The pixels themselves, HL_RGBA32F and packed, until the last unmap or the image is destroyed. */
hl_status hl_image_map(hl_image *image, const float **pixels, uint64_t *count);
hl_status hl_image_unmap(hl_image *image);
/* The same of one layer: packed floats, top row first; count: numbers. Unmapped by hl_image_unmap too. */
hl_status hl_image_read_layer(const hl_image *image, uint32_t layer, float *data, uint64_t count);
hl_status hl_image_map_layer(hl_image *image, uint32_t layer, const float **data, uint64_t *count);
hl_status hl_image_save(const hl_image *image, const char *path, const hl_save_info *info); /* .exr, .png; whole or not at all */
/* b is the reference: what it covers counts. A background covers everything and dilutes relative errors: compare without one. */
hl_status hl_image_compare(const hl_image *a, const hl_image *b, hl_difference *difference);
hl_status hl_image_difference(const hl_image *a, const hl_image *b, int32_t kind, hl_image **image);

/* ---- Jobs ------------------------------------------------------------------------------------------------------ */

/* Told the stage ("classify", "sweep", "render", ...) and the fraction of the whole that is done: 0 first, never falling, 1 at
 * the end of what succeeds. Anything but 0 cancels. */
typedef int32_t (*hl_progress_fn)(void *user, const char *stage, float fraction);

typedef struct hl_job_state {
    uint32_t struct_size;
    int32_t struct_type;
    const void *next;
    int32_t status; /* HL_NOT_READY while it runs; then HL_OK, HL_ERROR_CANCELLED, or what went wrong */
    float fraction;
    char stage[32];
    uint32_t passes;     /* finished, each with a result */
    uint32_t directions; /* of the last pass (precompute), or samples a pixel (reference picture) */
    double seconds;      /* since it was started */
    double device_seconds; /* 0 where the device keeps no time */
    double error;          /* measured: relative L2 of the field, or standard error of the reference picture, infinite while none
                              of its samples was lit; negative: not */
    double error_low, error_high; /* 95 % interval */
} hl_job_state;

typedef struct hl_timing {
    uint32_t struct_size;
    int32_t struct_type;
    const void *next;
    char kernel[40];
    uint32_t calls;
    int32_t timed; /* 0: the device keeps no time */
    double seconds;
} hl_timing;

/* Leaves no sentence of a job that failed: hl_job_wait(job, 0) does. */
hl_status hl_job_poll(hl_job *job, hl_job_state *state);
/* Waits at most so many seconds (negative: as long as it takes): HL_TIMEOUT, or the job's own status. */
hl_status hl_job_wait(hl_job *job, double seconds);
/* Returns at once; the job ends after the dispatch under way, or what the host prepares between two: tenths of a second. */
hl_status hl_job_cancel(hl_job *job);
hl_status hl_job_timing(const hl_job *job, uint32_t index, hl_timing *timing); /* HL_END after the last kernel */
/* The result of the last finished pass, as a new handle; also while the job runs on and after it was cancelled. A progressive
 * field and a reference picture have several passes, each on its own a valid result; of a reference picture's last one
 * hl_job_state has samples and standard error, and the image its HL_LAYER_NOISE. All others give theirs at the end. */
hl_status hl_job_get_field(hl_job *job, hl_field **field);
hl_status hl_job_get_image(hl_job *job, hl_image **image);
hl_status hl_job_destroy(hl_job *job); /* cancels it and waits for its end: no callback of it runs afterwards */

/* What work will cost, before it starts, all parts of it together. Told by short pilots on this device, which are work
 * themselves: of a plan, the planning (two seconds of device time, or half of the field's, which its `seconds` count again, for
 * the work plans anew). The info's progress is told of them, and can cancel. A planned field that misses its tolerance and is
 * computed anew is not foreseen. */
typedef struct hl_estimate {
    uint32_t struct_size;
    int32_t struct_type;
    const void *next;
    uint64_t peak;    /* bytes of device memory held at once, with all that the engine holds already */
    uint64_t result;  /* bytes that stay with the field on the device, or bytes of the image in main memory, with its layers */
    uint64_t free;    /* bytes that the engine may still take */
    double seconds;   /* of device time; of wall clock where the device keeps none */
} hl_estimate;

hl_status hl_job_get_estimate(hl_job *job, hl_estimate *estimate); /* of hl_precompute_estimate_start; else HL_NOT_READY */

/* ---- Field ----------------------------------------------------------------------------------------------------- */

#define HL_LAMBERT 0   /* diffuse about the surface's normal */
#define HL_ISOTROPIC 1 /* as the volume, without a normal */

typedef struct hl_surface { /* an opaque isosurface in place of the translucent volume */
    uint32_t struct_size;
    int32_t struct_type;
    const void *next;
    double iso; /* opaque where the data are at least this */
    int32_t shading;
    int32_t own_albedo; /* 1: `albedo`; 0: the transfer function's at iso */
    float albedo[3];
    int32_t reserved;
} hl_surface;

#define HL_CLIP_SIDE 0 /* a plane's d counts longest sides from the volume's centre */
#define HL_CLIP_WORLD 1

typedef struct hl_clip { /* what is kept of a volume; beyond it is vacuum */
    uint32_t struct_size;
    int32_t struct_type;
    const void *next;
    double low[3], high[3]; /* corners of the kept box, fractions 0..1 of the volume's own sides; all 0: no box */
    const double *planes;   /* nx, ny, nz, d of each: n.p >= d is kept, along the unit normal, world axes */
    uint32_t plane_count;   /* at most 10 */
    int32_t space;          /* of d */
} hl_clip;

#define HL_METHOD_MARCH 1
#define HL_METHOD_HIERARCHICAL 2
#define HL_METHOD_SWEEP 3

#define HL_FILTER_BOX 1
#define HL_FILTER_PRODUCT 2
#define HL_FILTER_AXIS 3
#define HL_FILTER_EXTINCTION 4

#define HL_QUALITY_DRAFT 1
#define HL_QUALITY_NORMAL 2
#define HL_QUALITY_FINE 3

/* Members and defaults as the command's [visibility] keys. */
typedef struct hl_precompute_info {
    uint32_t struct_size;
    int32_t struct_type;
    const void *next;
    hl_volume *volume;
    hl_transfer *transfer;     /* NULL: a grey ramp */
    const hl_surface *surface; /* NULL: the translucent volume */
    hl_field *previous;        /* shared instead of computed anew if only colours differ from it (not if it is one pass of several,
                                  or was loaded); may be NULL */
    int32_t method;            /* 0: sweep */
    int32_t ratio;             /* voxels per cell along an axis: 1, 2, 4, 8; 0: 4 */
    uint32_t directions;       /* 0: 128 */
    int32_t bands;             /* 1 to 4; 0: 4 */
    int32_t bits;              /* 8, 16, 32; 0: 8 */
    int32_t filter;            /* hierarchical; 0: axis */
    int32_t jittered;          /* march, hierarchical; 1: the paper's patterns in place of one even set */
    int32_t near_slices;       /* sweep; 0: 1 */
    int32_t all_cells;         /* 1: also cells far from matter */
    int32_t progressive;       /* 1: results after every pass (sweep; a planned field that missed begins anew); else one */
    float growth;              /* hierarchical; 0: 0.25 */
    float step;                /* voxels; 0: 1 */
    double tolerance;          /* above 0: method, directions, near_slices, step (and ratio, bits where 0) by measuring */
    int32_t quality;           /* a tolerance and a ratio in a word; 0: none */
    int32_t measure;           /* 1: measure the finished field's error */
    double measure_seconds;    /* device time that measuring may take; 0: 60 */
    hl_progress_fn progress;
    void *user;
    const hl_clip *clip;       /* cuts matter, its shadows and what is seen of it; NULL: nothing */
    uint32_t fit;              /* sweep, no surface: points of matter per cell that it is fitted to, to read right between cells */
    int32_t reserved;
} hl_precompute_info;

typedef struct hl_field_info {
    uint32_t struct_size;
    int32_t struct_type;
    const void *next;
    uint32_t dims[3]; /* cells */
    int32_t coefficients;
    int32_t method, ratio, bits, near_slices; /* as used; a plan may have chosen them */
    uint32_t directions;
    float step;
    uint64_t bytes;                      /* on the device */
    double error, error_low, error_high; /* measured relative L2 and its 95 % interval; negative: not measured */
} hl_field_info;

hl_status hl_precompute(hl_engine *engine, const hl_precompute_info *info, hl_field **field); /* waits */
hl_status hl_precompute_start(hl_engine *engine, const hl_precompute_info *info, hl_job **job);
hl_status hl_precompute_estimate(hl_engine *engine, const hl_precompute_info *info, hl_estimate *estimate); /* waits */
hl_status hl_precompute_estimate_start(hl_engine *engine, const hl_precompute_info *info, hl_job **job);
hl_status hl_field_destroy(hl_field *field);
hl_status hl_field_get_info(const hl_field *field, hl_field_info *info);
/* Coefficients as renderers see them: coefficient fastest, then x, y, z; count = coefficients * cells. */
hl_status hl_field_read(const hl_field *field, float *data, uint64_t count);
hl_status hl_field_map(hl_field *field, const float **data, uint64_t *count); /* until the last unmap or destroy */
hl_status hl_field_unmap(hl_field *field);
hl_status hl_field_save(const hl_field *field, const char *path); /* .nrrd */
/* A field that was saved, here or by the command, for the same volume and matter, which it is checked to be of where its file
 * says so; of info its volume, transfer, surface and clip. */
hl_status hl_field_load(hl_engine *engine, const char *path, const hl_precompute_info *info, hl_field **field);

/* ---- Pictures -------------------------------------------------------------------------------------------------- */

#define HL_CAMERA_FRAME 0 /* position and target do not matter: the whole volume is in view */
#define HL_CAMERA_SIDE 1  /* they count in longest sides from the volume's centre */
#define HL_CAMERA_WORLD 2

typedef struct hl_camera {
    uint32_t struct_size;
    int32_t struct_type;
    const void *next;
    double position[3];
    double target[3];
    double up[3];       /* all 0: +z */
    double fov;         /* vertical; 0: 30 */
    double orbit[4];    /* axis (world) and degrees by which the camera is turned about the centre; all 0: none */
    double centre[3];   /* of the orbit, if own_centre is 1; else the target */
    double distance;    /* from the target, counted as the position; 0: as the position says */
    int32_t space;
    int32_t own_centre;
} hl_camera;

#define HL_BACKGROUND_NONE 0 /* the image keeps its coverage */
#define HL_BACKGROUND_COLOR 1
#define HL_BACKGROUND_LIGHT 2

typedef struct hl_render_info {
    uint32_t struct_size;
    int32_t struct_type;
    const void *next; /* hl_vulkan_image: into that image of the host's device, not to main memory */
    hl_field *field;
    hl_light *light; /* NULL: white */
    const hl_camera *camera; /* NULL: the whole volume is in view */
    uint32_t width, height; /* 0: 1024, 768 */
    double step;            /* voxels; 0: 1 */
    int32_t background;
    float background_color[3];
    double reference;           /* above 0: no field's light but Monte Carlo, to this relative standard error; needs a
                                   constant light or a probe */
    double reference_seconds;   /* no further pass begins after so many; 0: no bound */
    uint32_t reference_samples; /* most samples a pixel; 0: 65536 */
    uint32_t seed;
    hl_progress_fn progress;
    void *user;
    const hl_clip *clip;  /* cuts the view further, to look into what the light still sees whole; NULL: as the field's */
    uint32_t layers;      /* sum of HL_LAYER_... that the image gets */
    int32_t every_block;  /* 1: do not leap over empty blocks: slower, the same picture */
} hl_render_info;

hl_status hl_render(hl_engine *engine, const hl_render_info *info, hl_image **image); /* waits */
hl_status hl_render_start(hl_engine *engine, const hl_render_info *info, hl_job **job);
hl_status hl_render_estimate(hl_engine *engine, const hl_render_info *info, hl_estimate *estimate); /* waits */

/* Layouts, where pointers have 8 bytes: what a binding in another language must match. */
#if defined(__cplusplus) && __cplusplus >= 201103L
#define HL_ASSERT_SIZE(type, size) static_assert(sizeof(void *) != 8 || sizeof(type) == (size), #type)
#elif defined(__STDC_VERSION__) && __STDC_VERSION__ >= 201112L
#define HL_ASSERT_SIZE(type, size) _Static_assert(sizeof(void *) != 8 || sizeof(type) == (size), #type)
#else
#define HL_ASSERT_SIZE(type, size) typedef char HL_SIZE_OF_##type[sizeof(void *) != 8 || sizeof(type) == (size) ? 1 : -1]
#endif
HL_ASSERT_SIZE(hl_header, 16);
HL_ASSERT_SIZE(hl_engine_info, 72);
HL_ASSERT_SIZE(hl_device_info, 608);
HL_ASSERT_SIZE(hl_volume_info, 232);
HL_ASSERT_SIZE(hl_load_info, 64);
HL_ASSERT_SIZE(hl_transfer_info, 40);
HL_ASSERT_SIZE(hl_transfer_file_info, 48);
HL_ASSERT_SIZE(hl_light_info, 128);
HL_ASSERT_SIZE(hl_image_info, 72);
HL_ASSERT_SIZE(hl_save_info, 40);
HL_ASSERT_SIZE(hl_difference, 48);
HL_ASSERT_SIZE(hl_job_state, 104);
HL_ASSERT_SIZE(hl_timing, 72);
HL_ASSERT_SIZE(hl_estimate, 48);
HL_ASSERT_SIZE(hl_surface, 48);
HL_ASSERT_SIZE(hl_clip, 80);
HL_ASSERT_SIZE(hl_precompute_info, 152);
HL_ASSERT_SIZE(hl_field_info, 88);
HL_ASSERT_SIZE(hl_camera, 168);
HL_ASSERT_SIZE(hl_render_info, 128);

#ifdef __cplusplus
}
#endif

#endif
