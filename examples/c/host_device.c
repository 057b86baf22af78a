/* halflight on a Vulkan device of one's own: host_device VOLUME.raw NX NY NZ PICTURE.png
 * Makes a device, lends it, has the picture rendered into an image of its own, and reads that back itself. */
#include <halflight_vulkan.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <vulkan/vulkan.h>

enum { WIDTH = 640, HEIGHT = 480 };
static const VkDeviceSize BYTES = (VkDeviceSize)WIDTH * HEIGHT * 16;

static hl_engine *engine;
static VkInstance instance;
static VkPhysicalDevice physical;
static VkDevice device;
static VkQueue queue;
static uint32_t family;
static pthread_mutex_t queue_mutex = PTHREAD_MUTEX_INITIALIZER; /* guards `queue`, ours and the library's */
static VkDebugUtilsMessengerEXT messenger;
static int complaints;

static void halflight(hl_status status, const char *call) {
    char why[512];
    if (status == HL_OK) return;
    hl_last_error(engine, why, sizeof why);
    fprintf(stderr, "%s: %s\n", call, why);
    exit(1);
}
static void vulkan(VkResult result, const char *call) {
    if (result == VK_SUCCESS) return;
    fprintf(stderr, "%s: %d\n", call, (int)result);
    exit(1);
}
#define HL(call) halflight((call), #call)
#define VK(call) vulkan((call), #call)

static void lock_queue(void *user, uint32_t f, uint32_t index) { (void)f, (void)index, pthread_mutex_lock((pthread_mutex_t *)user); }
static void unlock_queue(void *user, uint32_t f, uint32_t index) { (void)f, (void)index, pthread_mutex_unlock((pthread_mutex_t *)user); }

static VKAPI_ATTR VkBool32 VKAPI_CALL complain(VkDebugUtilsMessageSeverityFlagBitsEXT severity, VkDebugUtilsMessageTypeFlagsEXT types,
                                               const VkDebugUtilsMessengerCallbackDataEXT *data, void *user) {
    (void)severity, (void)types, (void)user;
    ++complaints;
    fprintf(stderr, "validation: %s\n", data->pMessage);
    return VK_FALSE;
}

/* With HOST_DEVICE_VALIDATE set: the validation layer, and a complaint is a failure. */
static const char *const INSTANCE_EXTENSIONS[] = {VK_EXT_DEBUG_UTILS_EXTENSION_NAME};
static void make_instance(int validate) {
    static const char *const layers[] = {"VK_LAYER_KHRONOS_validation"};
    VkApplicationInfo app = {VK_STRUCTURE_TYPE_APPLICATION_INFO, NULL, "host_device", 1, NULL, 0, VK_API_VERSION_1_3};
    VkDebugUtilsMessengerCreateInfoEXT listen = {VK_STRUCTURE_TYPE_DEBUG_UTILS_MESSENGER_CREATE_INFO_EXT, NULL, 0,
        VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT, VK_DEBUG_UTILS_MESSAGE_TYPE_VALIDATION_BIT_EXT, complain, NULL};
    VkInstanceCreateInfo info = {VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO, validate ? &listen : NULL, 0, &app,
        validate ? 1u : 0u, layers, validate ? 1u : 0u, INSTANCE_EXTENSIONS};
    VK(vkCreateInstance(&info, NULL, &instance));
    if (validate) {
        PFN_vkCreateDebugUtilsMessengerEXT create =
            (PFN_vkCreateDebugUtilsMessengerEXT)vkGetInstanceProcAddr(instance, "vkCreateDebugUtilsMessengerEXT");
        VK(create(instance, &listen, NULL, &messenger));
    }
}

/* The first device that the library can work on, with what it wants enabled. */
static VkPhysicalDeviceSynchronization2Features synchronization2;
static VkPhysicalDeviceMaintenance4Features maintenance4;
static VkPhysicalDeviceFeatures2 features;
static void make_device(void) {
    VkPhysicalDevice all[16];
    VkQueueFamilyProperties families[16];
    uint32_t count = 16, i;
    float priority = 1;
    char why[512];
    VK(vkEnumeratePhysicalDevices(instance, &count, all));
    for (i = 0; i < count && !physical; ++i) {
        if (hl_vulkan_check((hl_vulkan_loader)vkGetInstanceProcAddr, instance, VK_API_VERSION_1_3, all[i]) == HL_OK) physical = all[i];
        else hl_last_error(NULL, why, sizeof why), fprintf(stderr, "passed over: %s\n", why);
    }
    if (!physical) fprintf(stderr, "no device will do\n"), exit(1);
    count = 16;
    vkGetPhysicalDeviceQueueFamilyProperties(physical, &count, families);
    while (family < count && !(families[family].queueFlags & VK_QUEUE_COMPUTE_BIT)) ++family;
    synchronization2.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SYNCHRONIZATION_2_FEATURES;
    synchronization2.synchronization2 = VK_TRUE;
    maintenance4.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MAINTENANCE_4_FEATURES;
    maintenance4.pNext = &synchronization2;
    maintenance4.maintenance4 = VK_TRUE;
    features.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2;
    features.pNext = &maintenance4;
    features.features.shaderStorageImageExtendedFormats = VK_TRUE;
    features.features.shaderStorageImageWriteWithoutFormat = VK_TRUE;
    {
        VkDeviceQueueCreateInfo one = {VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO, NULL, 0, family, 1, &priority};
        VkDeviceCreateInfo info = {VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO, &features, 0, 1, &one, 0, NULL, 0, NULL, NULL};
        VK(vkCreateDevice(physical, &info, NULL, &device));
    }
    vkGetDeviceQueue(device, family, 0, &queue);
}

static VkDeviceMemory memory(VkMemoryRequirements needs, VkMemoryPropertyFlags flags) {
    VkPhysicalDeviceMemoryProperties types;
    VkMemoryAllocateInfo info = {VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO, NULL, needs.size, 0};
    VkDeviceMemory made;
    vkGetPhysicalDeviceMemoryProperties(physical, &types);
    while (!(needs.memoryTypeBits >> info.memoryTypeIndex & 1) ||
           (types.memoryTypes[info.memoryTypeIndex].propertyFlags & flags) != flags)
        if (++info.memoryTypeIndex == types.memoryTypeCount) fprintf(stderr, "no such memory\n"), exit(1);
    VK(vkAllocateMemory(device, &info, NULL, &made));
    return made;
}

/* The image's pixels, through a buffer and a command buffer of our own. */
static void read_back(VkImage image, VkBuffer buffer) {
    VkCommandPoolCreateInfo pool_info = {VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO, NULL, 0, family};
    VkCommandBufferAllocateInfo commands_info = {VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO, NULL, VK_NULL_HANDLE,
        VK_COMMAND_BUFFER_LEVEL_PRIMARY, 1};
    VkCommandBufferBeginInfo begin = {VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO, NULL, VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT, NULL};
    VkBufferImageCopy region = {0, 0, 0, {VK_IMAGE_ASPECT_COLOR_BIT, 0, 0, 1}, {0, 0, 0}, {WIDTH, HEIGHT, 1}};
    VkBufferMemoryBarrier to_host = {VK_STRUCTURE_TYPE_BUFFER_MEMORY_BARRIER, NULL, VK_ACCESS_TRANSFER_WRITE_BIT, VK_ACCESS_HOST_READ_BIT,
        VK_QUEUE_FAMILY_IGNORED, VK_QUEUE_FAMILY_IGNORED, buffer, 0, VK_WHOLE_SIZE};
    VkFenceCreateInfo fence_info = {VK_STRUCTURE_TYPE_FENCE_CREATE_INFO, NULL, 0};
    VkSubmitInfo submit = {VK_STRUCTURE_TYPE_SUBMIT_INFO, NULL, 0, NULL, NULL, 1, NULL, 0, NULL};
    VkCommandPool pool;
    VkCommandBuffer commands;
    VkFence fence;
    VK(vkCreateCommandPool(device, &pool_info, NULL, &pool));
    commands_info.commandPool = pool;
    VK(vkAllocateCommandBuffers(device, &commands_info, &commands));
    VK(vkBeginCommandBuffer(commands, &begin));
    vkCmdCopyImageToBuffer(commands, image, VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL, buffer, 1, &region);
    vkCmdPipelineBarrier(commands, VK_PIPELINE_STAGE_TRANSFER_BIT, VK_PIPELINE_STAGE_HOST_BIT, 0, 0, NULL, 1, &to_host, 0, NULL);
    VK(vkEndCommandBuffer(commands));
    VK(vkCreateFence(device, &fence_info, NULL, &fence));
    submit.pCommandBuffers = &commands;
    lock_queue(&queue_mutex, family, 0);
    VK(vkQueueSubmit(queue, 1, &submit, fence));
    unlock_queue(&queue_mutex, family, 0);
    VK(vkWaitForFences(device, 1, &fence, VK_TRUE, UINT64_MAX));
    vkDestroyFence(device, fence, NULL);
    vkDestroyCommandPool(device, pool, NULL);
}

int main(int argc, char **argv) {
    int validate = getenv("HOST_DEVICE_VALIDATE") != NULL;
    hl_vulkan_queue lent_queue = {0, 0, 0};
    hl_vulkan_device lent;
    hl_engine_info engine_info;
    hl_volume_info volume_info;
    hl_precompute_info precompute_info;
    hl_vulkan_image target;
    hl_render_info render_info;
    hl_image_info image_info;
    hl_image *copy;
    unsigned char *data;
    size_t size = 1;
    unsigned a;
    FILE *file;

    if (argc != 6) return fprintf(stderr, "usage: %s VOLUME.raw NX NY NZ PICTURE.png\n", argv[0]), 2;
    HL_INIT(volume_info);
    for (a = 0; a < 3; ++a) size *= volume_info.dims[a] = (uint32_t)strtoul(argv[2 + a], NULL, 10);
    data = (unsigned char *)malloc(size);
    file = fopen(argv[1], "rb");
    if (!data || !file || fread(data, 1, size, file) != size) return fprintf(stderr, "%s: cannot read\n", argv[1]), 1;
    fclose(file);

    make_instance(validate);
    make_device();

    HL_INIT_AS(lent, HL_STRUCT_VULKAN_DEVICE);
    lent.loader = (hl_vulkan_loader)vkGetInstanceProcAddr;
    lent.instance = instance;
    lent.physical_device = physical;
    lent.device = device;
    lent.api_version = VK_API_VERSION_1_3;
    lent.features = &features;
    lent.extensions = INSTANCE_EXTENSIONS;
    lent.extension_count = validate ? 1 : 0;
    lent_queue.family = family;
    lent.queues = &lent_queue;
    lent.queue_count = 1;
    lent.lock_queue = lock_queue;
    lent.unlock_queue = unlock_queue;
    lent.lock_user = &queue_mutex;
    HL_INIT(engine_info);
    engine_info.next = &lent;
    HL(hl_engine_create(&engine_info, &engine));

    volume_info.data = data;
    volume_info.type = HL_UINT8;
    HL_INIT(precompute_info);
    HL(hl_volume_create(engine, &volume_info, &precompute_info.volume));
    free(data);
    precompute_info.method = HL_METHOD_SWEEP;
    precompute_info.directions = 96;
    HL_INIT(render_info);
    HL(hl_precompute(engine, &precompute_info, &render_info.field));

    {
        VkImageCreateInfo made = {VK_STRUCTURE_TYPE_IMAGE_CREATE_INFO, NULL, 0, VK_IMAGE_TYPE_2D, VK_FORMAT_R32G32B32A32_SFLOAT,
            {WIDTH, HEIGHT, 1}, 1, 1, VK_SAMPLE_COUNT_1_BIT, VK_IMAGE_TILING_OPTIMAL,
            VK_IMAGE_USAGE_TRANSFER_SRC_BIT | VK_IMAGE_USAGE_TRANSFER_DST_BIT, VK_SHARING_MODE_EXCLUSIVE, 0, NULL, VK_IMAGE_LAYOUT_UNDEFINED};
        VkBufferCreateInfo wanted = {VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO, NULL, 0, BYTES, VK_BUFFER_USAGE_TRANSFER_DST_BIT,
            VK_SHARING_MODE_EXCLUSIVE, 0, NULL};
        VkMemoryRequirements needs;
        VkDeviceMemory image_memory, buffer_memory;
        VkImage image;
        VkBuffer buffer;
        void *pixels;
        VK(vkCreateImage(device, &made, NULL, &image));
        vkGetImageMemoryRequirements(device, image, &needs);
        image_memory = memory(needs, 0);
        VK(vkBindImageMemory(device, image, image_memory, 0));
        VK(vkCreateBuffer(device, &wanted, NULL, &buffer));
        vkGetBufferMemoryRequirements(device, buffer, &needs);
        buffer_memory = memory(needs, VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT);
        VK(vkBindBufferMemory(device, buffer, buffer_memory, 0));
        VK(vkMapMemory(device, buffer_memory, 0, VK_WHOLE_SIZE, 0, &pixels));

        HL_INIT_AS(target, HL_STRUCT_VULKAN_IMAGE);
        memcpy(&target.image, &image, sizeof image); /* a pointer, or a 64-bit number where pointers are shorter */
        target.format = VK_FORMAT_R32G32B32A32_SFLOAT;
        target.extent[0] = WIDTH;
        target.extent[1] = HEIGHT;
        target.extent[2] = 1;
        target.usage = made.usage;
        target.layout = VK_IMAGE_LAYOUT_UNDEFINED;
        target.layout_after = VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL;
        target.queue_family = HL_VULKAN_NO_FAMILY;
        render_info.next = &target;
        render_info.width = WIDTH;
        render_info.height = HEIGHT;
        HL(hl_render(engine, &render_info, NULL)); /* into our image; it is ours again when the call returns */
        read_back(image, buffer);

        HL_INIT(image_info);
        image_info.data = pixels;
        image_info.width = WIDTH;
        image_info.height = HEIGHT;
        HL(hl_image_create(engine, &image_info, &copy));
        HL(hl_image_save(copy, argv[5], NULL));
        HL(hl_engine_destroy(engine)); /* the device stays ours */
        vkDestroyBuffer(device, buffer, NULL);
        vkDestroyImage(device, image, NULL);
        vkFreeMemory(device, buffer_memory, NULL);
        vkFreeMemory(device, image_memory, NULL);
    }
    VK(vkDeviceWaitIdle(device));
    vkDestroyDevice(device, NULL);
    if (messenger)
        ((PFN_vkDestroyDebugUtilsMessengerEXT)vkGetInstanceProcAddr(instance, "vkDestroyDebugUtilsMessengerEXT"))(instance, messenger, NULL);
    vkDestroyInstance(instance, NULL);
    return complaints ? 1 : 0;
}
