// 1 - exp(-x) without cancellation: thin media are seen at any step.
float opacity_of(float depth) {
    float series = depth * (1.0 - depth * (0.5 - depth * (1.0 / 6.0 - depth * (1.0 / 24.0))));
    return depth < 0.05 ? series : 1.0 - exp(-depth);
}
