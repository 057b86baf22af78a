"""Compares a picture of halflight with an independent renderer's (Mitsuba 3 volpath, single scattering, saved as float32
[SIZE, SIZE, 4] by numpy: linear RGB and alpha).

usage: oracle_compare.py probe PROBE.hdr OUT.exr          the probe as Mitsuba looks it up: its rows lie at j/(H-1), with the
                                                          first and last on the poles, where halflight's lie at (j+1/2)/H
       oracle_compare.py picture PICTURE.exr ORACLE.npy [DIFFERENCE.png]
                                                          relative RMSE over the pixels that both cover, and what is left of
                                                          it after 8x8 averaging (Monte Carlo noise goes, bias stays)
"""
import sys, numpy as np
import mitsuba as mi
mi.set_variant('scalar_rgb')

def read(path):
    # Other channels, as the standard errors of a reference picture, are split off.
    whole = mi.Bitmap(path)
    root = whole if whole.channel_count() <= 4 else dict(whole.split())['<root>']
    return np.array(root.convert(mi.Bitmap.PixelFormat.RGBA, mi.Struct.Type.Float32, False))

def probe(source, target, height=512):
    rgb = read(source)[..., :3]; h, w = rgb.shape[:2]
    row = (np.arange(height) + .5) / height * (h - 1); col = (np.arange(2 * height) + .5) / (2 * height) * w - .5
    r0 = np.floor(row).astype(int); fr = (row - r0)[:, None, None]; r1 = np.minimum(r0 + 1, h - 1)
    c0 = np.floor(col).astype(int); fc = (col - c0)[None, :, None]; c1 = (c0 + 1) % w; c0 = c0 % w
    out = (rgb[r0][:, c0] * (1 - fc) + rgb[r0][:, c1] * fc) * (1 - fr) + (rgb[r1][:, c0] * (1 - fc) + rgb[r1][:, c1] * fc) * fr
    mi.Bitmap(out.astype(np.float32)).write(target)

def relative_rmse(a, b, mask):
    return float(np.sqrt(((a - b)[mask] ** 2).mean()) / b[mask].mean())

def blocks(x, n=8):
    h, w = x.shape[0] // n * n, x.shape[1] // n * n
    return x[:h, :w].reshape(h // n, n, w // n, n, -1).mean((1, 3))

def picture(path, oracle, difference=None):
    a, b = read(path), np.load(oracle)
    if a.shape != b.shape: sys.exit(f'{path}: {a.shape}, {oracle}: {b.shape}; both must have the same size')
    mask = b[..., 3] > .01
    print(f'pixels covered: {mask.mean():.3f}; mean radiance {a[mask][:, :3].mean():.5f} against {b[mask][:, :3].mean():.5f} '
          f'({a[mask][:, :3].mean() / b[mask][:, :3].mean() - 1:+.2%}); coverage differs by {np.abs(a - b)[..., 3].mean():.5f} on average')
    print(f'relative RMSE {relative_rmse(a[..., :3], b[..., :3], mask):.4f}')
    m = blocks(mask[..., None].astype(float))[..., 0] > .99
    print(f'relative RMSE of 8x8 means {relative_rmse(blocks(a[..., :3]), blocks(b[..., :3]), m):.4f}')
    if difference:
        d = (a - b)[..., :3] / b[mask][:, :3].mean()
        side = np.concatenate([a[..., :3], b[..., :3], .5 * b[mask][:, :3].mean() + d * b[mask][:, :3].mean()], 1)
        mi.util.write_bitmap(difference, np.clip(side * .4 / b[mask][:, :3].mean(), 0, 1).astype(np.float32))

if __name__ == '__main__':
    if len(sys.argv) < 4 or sys.argv[1] not in ('probe', 'picture'): sys.exit(__doc__)
    probe(*sys.argv[2:4]) if sys.argv[1] == 'probe' else picture(*sys.argv[2:5])
