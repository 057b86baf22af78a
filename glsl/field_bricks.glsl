// Where a cell's coefficients stand. The field's images hold bricks of BRICK^3 cells (thinner where the field is), and only
// those in which somebody reads a cell; a texel of the directory stands for each brick: bit 31 if it is held, and its place
// among the held ones (x and y 8 bits, z 15), counted in bricks. Twin: src/stages/bricks.rs.
// Counted: one texel of the directory per cell.
const int BRICK_SHIFT = 2; // of BRICK
const uint HELD = 0x80000000u;

uint brick_of(usampler3D directory, ivec3 cell) {
    return texelFetch(directory, cell >> BRICK_SHIFT, 0).x;
}

// The texel of a cell of this brick.
ivec3 texel_of(uint brick, ivec3 cell, ivec3 field_dims) {
    ivec3 place = ivec3(brick & 255u, (brick >> 8) & 255u, (brick >> 16) & 32767u);
    return place * min(ivec3(BRICK), field_dims) + (cell & (BRICK - 1));
}
