/* A headerless volume of bytes to a picture: minimal VOLUME.raw NX NY NZ PICTURE.png */
#include <halflight.h>
#include <stdio.h>
#include <stdlib.h>

static hl_engine *engine;

static void check(hl_status status, const char *what) {
    char why[512];
    if (status == HL_OK) return;
    hl_last_error(engine, why, sizeof why);
    fprintf(stderr, "%s: %s\n", what, why);
    hl_engine_destroy(engine); /* and all that was made from it */
    exit(1);
}

int main(int argc, char **argv) {
    hl_volume_info volume_info;
    hl_precompute_info precompute_info;
    hl_render_info render_info;
    hl_volume *volume;
    hl_image *image;
    unsigned char *data;
    size_t size = 1;
    FILE *file;
    int a;

    if (argc != 6) return fprintf(stderr, "usage: %s VOLUME.raw NX NY NZ PICTURE.png\n", argv[0]), 2;
    HL_INIT(volume_info);
    for (a = 0; a < 3; ++a) size *= volume_info.dims[a] = (uint32_t)strtoul(argv[2 + a], NULL, 10);
    data = (unsigned char *)malloc(size);
    file = fopen(argv[1], "rb");
    if (!data || !file || fread(data, 1, size, file) != size) return fprintf(stderr, "%s: cannot read\n", argv[1]), 1;
    fclose(file);

    check(hl_engine_create(NULL, &engine), "engine");

    volume_info.data = data; /* copied */
    volume_info.type = HL_UINT8;
    check(hl_volume_create(engine, &volume_info, &volume), "volume");
    free(data);

    HL_INIT(precompute_info);
    precompute_info.volume = volume; /* without a transfer function: a grey ramp over the data */
    precompute_info.method = HL_METHOD_SWEEP;
    precompute_info.directions = 96;
    HL_INIT(render_info);
    check(hl_precompute(engine, &precompute_info, &render_info.field), "precompute");

    render_info.width = 640; /* without a light: white from everywhere; without a camera: all in view */
    render_info.height = 480;
    check(hl_render(engine, &render_info, &image), "render");
    check(hl_image_save(image, argv[5], NULL), argv[5]);
    hl_engine_destroy(engine);
    return 0;
}
