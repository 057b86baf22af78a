/* halflight on the Vulkan device of its host: for hosts that have one already. Include vulkan.h or not, as you like: handles
 * are passed as pointers (dispatchable ones) and 64-bit numbers (all others), enumerations and flags as their values.
 *
 *   1. ask:     hl_vulkan_get_requirement lists what a device must have; hl_vulkan_check asks one physical device.
 *   2. create:  hl_engine_info.next = a hl_vulkan_device. Instance and device must outlive the engine, which destroys neither.
 *   3. volumes: hl_volume_info.next = a hl_vulkan_image or hl_vulkan_buffer, with data NULL. Copied on the device.
 *   4. pictures: hl_render_info.next = a hl_vulkan_image. Written on the device, over no background.
 *
 * Plans, error measurements, histograms, hl_field_save and hl_field_load of such volumes read them back to main memory, each time.
 *
 * Images and buffers are the engine's from the call (or the job's start) until the call returns (the job ends), or as the
 * semaphores order it. Of what belongs to another queue family than the engine's (hl_vulkan_get_family), the host records its
 * half of each hand-over: before, a barrier from its family to the engine's, layouts `layout` to `layout`; after, one from the
 * engine's to its own, layouts `layout_after` to `layout_after`. A wait that has been submitted holds the engine's queue until
 * the host signals it, also where its job is cancelled or the engine destroyed. */
#ifndef HALFLIGHT_VULKAN_H
#define HALFLIGHT_VULKAN_H

#include "halflight.h"

#ifdef __cplusplus
extern "C" {
#endif

#define HL_STRUCT_VULKAN_DEVICE 1
#define HL_STRUCT_VULKAN_IMAGE 2
#define HL_STRUCT_VULKAN_BUFFER 3

/* HL_INIT with the type of an extension. */
#define HL_INIT_AS(s, type) (HL_INIT(s), (s).struct_type = (type))

/* vkGetInstanceProcAddr of the loader that the host uses. */
typedef void (*hl_vulkan_function)(void);
typedef hl_vulkan_function (*hl_vulkan_loader)(void *instance, const char *name);

#define HL_VULKAN_API_VERSION 0      /* `value`: of instance and device, at least */
#define HL_VULKAN_QUEUE 1            /* `value`: VkQueueFlags of one queue */
#define HL_VULKAN_FEATURE 2          /* `name`, and the `structure` that holds it */
#define HL_VULKAN_FORMAT 3           /* `value`: VkFormatFeatureFlags in optimal tiling; `format` */
#define HL_VULKAN_INSTANCE_EXTENSION 4
#define HL_VULKAN_DEVICE_EXTENSION 5

typedef struct hl_vulkan_requirement {
    uint32_t struct_size;
    int32_t struct_type;
    const void *next;
    int32_t kind;     /* HL_VULKAN_... */
    int32_t required; /* 0: used where it is enabled */
    uint32_t value;
    int32_t format; /* VkFormat */
    char name[64];
    char structure[64];
} hl_vulkan_requirement;

/* The index-th requirement; HL_END after the last. */
hl_status hl_vulkan_get_requirement(uint32_t index, hl_vulkan_requirement *requirement);

/* HL_OK, or HL_ERROR_DEVICE_LACKS with a sentence that names everything missing (hl_last_error(NULL, ...)). api_version is
 * the instance's VkApplicationInfo::apiVersion. */
hl_status hl_vulkan_check(hl_vulkan_loader loader, void *instance, uint32_t api_version, void *physical_device);

typedef struct hl_vulkan_queue {
    uint32_t family, index;
    uint32_t flags; /* VkDeviceQueueCreateFlags, mostly 0 */
} hl_vulkan_queue;

/* Called in pairs, on whatever thread, around each vkQueueSubmit2 and around nothing else. Not to call the engine, nor to throw. */
typedef void (*hl_queue_fn)(void *user, uint32_t family, uint32_t index);

typedef struct hl_vulkan_device {
    uint32_t struct_size;
    int32_t struct_type; /* HL_STRUCT_VULKAN_DEVICE */
    const void *next;
    hl_vulkan_loader loader;
    void *instance;
    void *physical_device;
    void *device;
    const void *features;          /* VkDeviceCreateInfo::pNext, with a VkPhysicalDeviceFeatures2 in it */
    const char *const *extensions; /* enabled, of instance and device */
    const hl_vulkan_queue *queues; /* that the engine may use: it takes the first of a family that computes */
    uint32_t extension_count;
    uint32_t queue_count;
    hl_queue_fn lock_queue; /* both or none; none: nobody else uses the queue while a call or a job runs */
    hl_queue_fn unlock_queue;
    void *lock_user;
    uint32_t api_version; /* of the instance */
    uint32_t reserved;
} hl_vulkan_device;

#define HL_VULKAN_NO_FAMILY 0xffffffffu /* VK_QUEUE_FAMILY_IGNORED */

/* Formats. A volume: R8_UNORM, R8_UINT, R8_SINT, R16_UNORM, R16_UINT, R16_SINT, R16_SFLOAT or R32_SFLOAT; samples count as the
 * integers or floats that are stored (a UNORM's as integers too), and must be finite. A picture: R32G32B32A32_SFLOAT or
 * R16G16B16A16_SFLOAT; premultiplied linear RGBA, top row first. */

typedef struct hl_vulkan_image {
    uint32_t struct_size;
    int32_t struct_type; /* HL_STRUCT_VULKAN_IMAGE */
    const void *next;
    uint64_t image;        /* VkImage, 3-D for a volume, 2-D for a picture */
    int32_t format;        /* VkFormat, as above */
    uint32_t extent[3];    /* texels; z is 1 for pictures */
    uint32_t usage;        /* VkImageUsageFlags: TRANSFER_SRC of volumes, TRANSFER_DST of pictures */
    int32_t layout;        /* VkImageLayout now; 0: undefined */
    int32_t layout_after;  /* 0: as it came, GENERAL if that is undefined */
    uint32_t queue_family; /* that owns it; HL_VULKAN_NO_FAMILY: nobody hands over */
    uint64_t wait_semaphore; /* timeline semaphore and value before it is touched; 0: none */
    uint64_t wait_value;
    uint64_t signal_semaphore; /* and when it is handed back */
    uint64_t signal_value;
    int32_t *handed_back; /* set to 1 when it was, to 0 when it was not touched, also by a refusal;
                            lives until the call returns or the job ends; may be NULL */
} hl_vulkan_image;

typedef struct hl_vulkan_buffer {
    uint32_t struct_size;
    int32_t struct_type; /* HL_STRUCT_VULKAN_BUFFER */
    const void *next;
    uint64_t buffer;       /* VkBuffer, TRANSFER_SRC; samples of hl_volume_info.type: 8 or 16 bits, or HL_FLOAT32 */
    uint64_t size, offset; /* bytes: of the buffer, to the first sample */
    uint64_t row_bytes;    /* 0: rows without gaps */
    uint64_t slice_bytes;  /* 0: slices without gaps */
    uint64_t wait_semaphore;
    uint64_t wait_value;
    uint64_t signal_semaphore;
    uint64_t signal_value;
    int32_t *handed_back;
    uint32_t queue_family;
    uint32_t reserved;
} hl_vulkan_buffer;

/* The queue family that the engine works on. */
hl_status hl_vulkan_get_family(const hl_engine *engine, uint32_t *family);

HL_ASSERT_SIZE(hl_vulkan_requirement, 160);
HL_ASSERT_SIZE(hl_vulkan_queue, 12);
HL_ASSERT_SIZE(hl_vulkan_device, 112);
HL_ASSERT_SIZE(hl_vulkan_image, 96);
HL_ASSERT_SIZE(hl_vulkan_buffer, 104);

#ifdef __cplusplus
}
#endif

#endif
