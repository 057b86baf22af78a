/* A field that gets better while one looks, then cancelled, edited and relit: progressive VOLUME.raw NX NY NZ FOLDER
 * Writes pass-0.png, pass-1.png ..., edited.png and light-0.png to light-5.png. */
#include <halflight.h>
#include <stdio.h>
#include <stdlib.h>

static hl_engine *engine;

static int failed(hl_status status, const char *what) {
    char why[512];
    if (status >= 0) return 0;
    hl_last_error(engine, why, sizeof why);
    fprintf(stderr, "%s: %s\n", what, why);
    return 1;
}

/* Any call that may fail, and what to do then: the engine's end is the end of all that was made from it. */
#define TRY(call) do { if (failed((call), #call)) { hl_engine_destroy(engine); return 1; } } while (0)

/* On the thread of the call or of the job. */
static int32_t progress(void *user, const char *stage, float fraction) {
    int *last = (int *)user, now = (int)(10 * fraction);
    if (now != *last) printf("  %s %d %%\n", stage, 10 * (*last = now));
    return 0; /* go on */
}

static void sleep_a_moment(hl_job *job) { hl_job_wait(job, 0.01); }

/* A picture of a field under a light. */
static int picture(hl_field *field, hl_light *light, const char *folder, const char *name, unsigned number) {
    hl_render_info info;
    hl_image *image;
    char path[512];
    HL_INIT(info);
    info.field = field;
    info.light = light;
    info.width = 320;
    info.height = 240;
    info.background = HL_BACKGROUND_COLOR;
    if (hl_render(engine, &info, &image) != HL_OK) return HL_ERROR_INTERNAL;
    snprintf(path, sizeof path, "%s/%s-%u.png", folder, name, number);
    if (hl_image_save(image, path, NULL) != HL_OK) return HL_ERROR_IO;
    printf("wrote %s\n", path);
    return hl_image_destroy(image);
}

int main(int argc, char **argv) {
    static const double gold[] = {40, 0.9, 0.7, 0.3, 0, 110, 0.9, 0.7, 0.3, 0.2, 220, 0.9, 0.7, 0.3, 0.7};
    static const double blue[] = {40, 0.2, 0.5, 0.9, 0, 110, 0.2, 0.5, 0.9, 0.2, 220, 0.2, 0.5, 0.9, 0.7};
    static const double up[] = {0, 0, 1};
    hl_volume_info volume_info;
    hl_transfer_info transfer_info;
    hl_light_info light_info;
    hl_precompute_info info;
    hl_job_state state;
    hl_estimate cost;
    hl_volume *volume;
    hl_transfer *transfer;
    hl_light *light;
    hl_field *field = NULL, *edited;
    hl_job *job;
    unsigned char *data;
    size_t size = 1;
    unsigned seen = 0, i;
    int told = -1;
    FILE *file;

    if (argc != 6) return fprintf(stderr, "usage: %s VOLUME.raw NX NY NZ FOLDER\n", argv[0]), 2;
    HL_INIT(volume_info);
    for (i = 0; i < 3; ++i) size *= volume_info.dims[i] = (uint32_t)strtoul(argv[2 + i], NULL, 10);
    data = (unsigned char *)malloc(size);
    file = fopen(argv[1], "rb");
    if (!data || !file || fread(data, 1, size, file) != size) return fprintf(stderr, "%s: cannot read\n", argv[1]), 1;
    fclose(file);

    TRY(hl_engine_create(NULL, &engine));
    volume_info.data = data;
    volume_info.type = HL_UINT8;
    TRY(hl_volume_create(engine, &volume_info, &volume));
    free(data);
    HL_INIT(transfer_info);
    transfer_info.points = gold;
    transfer_info.count = 3;
    TRY(hl_transfer_create(engine, &transfer_info, &transfer));
    HL_INIT(light_info);
    light_info.kind = HL_LIGHT_CONE;
    light_info.toward[0] = 1;
    light_info.toward[2] = 0.5;
    light_info.half_angle = 40;
    light_info.radiance[0] = light_info.radiance[1] = light_info.radiance[2] = 8;
    TRY(hl_light_create(engine, &light_info, &light));

    /* What it will cost, then the work itself, on a thread of the library. */
    HL_INIT(info);
    info.volume = volume;
    info.transfer = transfer;
    info.method = HL_METHOD_SWEEP;
    info.directions = 1024;
    info.ratio = 2;
    info.progressive = 1;
    info.progress = progress;
    info.user = &told;
    HL_INIT(cost);
    TRY(hl_precompute_estimate(engine, &info, &cost));
    printf("about %.2f s of device time, %.1f MiB at most\n", cost.seconds, (double)cost.peak / (1 << 20));
    TRY(hl_precompute_start(engine, &info, &job));

    /* A picture after each pass, while the next is computed. */
    HL_INIT(state);
    do {
        sleep_a_moment(job);
        TRY(hl_job_poll(job, &state));
        if (state.passes > seen) {
            hl_field_destroy(field);
            TRY(hl_job_get_field(job, &field));
            printf("pass of %u directions\n", state.directions);
            TRY(picture(field, light, argv[5], "pass", seen++));
        }
    } while (state.status == HL_NOT_READY && seen < 2);

    /* Enough seen: what was finished stays. */
    TRY(hl_job_cancel(job));
    hl_job_wait(job, -1); /* HL_ERROR_CANCELLED, unless it was faster */
    TRY(hl_job_poll(job, &state));
    printf("ended with %d after %.2f s, %.2f s on the device\n", (int)state.status, state.seconds, state.device_seconds);
    hl_job_destroy(job);
    if (!field) return fprintf(stderr, "no pass was finished\n"), 1;

    /* Another colour: no visibility is computed, for nothing is more or less opaque than before. */
    TRY(hl_precompute(engine, &info, &edited));
    hl_field_destroy(field);
    transfer_info.points = blue;
    TRY(hl_transfer_set(transfer, &transfer_info));
    info.previous = edited;
    TRY(hl_precompute(engine, &info, &field));
    hl_field_destroy(edited);
    TRY(picture(field, light, argv[5], "edited", 0));

    /* The light goes round: only the irradiance and the picture are made anew. */
    for (i = 0; i < 6; ++i) {
        TRY(hl_light_rotate(light, up, 60.0 * i));
        TRY(picture(field, light, argv[5], "light", i));
    }
    hl_engine_destroy(engine);
    return 0;
}
