// Where the sums of a wanted cell stand: slot after slot in rows of SLOT_ROW, so that cells nobody reads take no memory.
ivec3 slot_place(uint slot) {
    uint row = uint(SLOT_ROW);
    return ivec3(slot % row, (slot / row) % row, slot / (row * row));
}
