"""Errors of a trajectory by numpy alone, to hold camber::trajectory_errors against.

trajectory_reference.py TRUTH.txt DRIVE.json: the truth has a KITTI row a frame.
"""
import json
import sys

import numpy as np

rows = np.loadtxt(sys.argv[1])
truth = np.tile(np.eye(4), (len(rows), 1, 1))
truth[:, :3, :] = rows.reshape(-1, 3, 4)
drive = json.load(open(sys.argv[2]))
estimate = {f['id']: np.array(f['world_from_camera']).reshape(4, 4)
            for f in drive['frames'] if f['world_from_camera'] is not None}
taken = [f['id'] for f in drive['frames']]
posed = [i for i in taken if i in estimate]
inverse = np.linalg.inv


def angle(r):
    axis = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    return np.arctan2(np.linalg.norm(axis) / 2, (np.trace(r[:3, :3]) - 1) / 2)


def length(poses):
    places = np.array([p[:3, 3] for p in poses])
    return np.linalg.norm(np.diff(places, axis=0), axis=1).sum()


path = np.array([length(truth[taken[:k + 1]]) for k in range(len(taken))])


def sub_paths(lengths, every):
    errors, unanswered = [], 0
    for size in lengths:
        for a in range(0, len(taken), every):
            beyond = np.nonzero(path > path[a] + size)[0]
            if not len(beyond):
                continue
            i, j = taken[a], taken[beyond[0]]
            if i not in estimate or j not in estimate:
                unanswered += 1
                continue
            e = inverse(inverse(estimate[i]) @ estimate[j]) @ inverse(truth[i]) @ truth[j]
            errors.append((np.linalg.norm(e[:3, 3]) / size, angle(e) / size))
    mean = np.mean(errors, axis=0) if errors else [None, None]
    return {'count': len(errors), 'unanswered': unanswered,
            'translation_percent': 100 * mean[0] if errors else None,
            'rotation_deg_per_100m': 100 * np.degrees(mean[1]) if errors else None}


def kitti(every):
    out = sub_paths(range(100, 801, 100), every)
    short = path[-1] < 150
    out['half'] = sub_paths([path[-1] / 2], every) if short else None
    return out


def window(w):
    ids = [i for i in posed if w['first'] <= i <= w['last']]
    error = np.log(length([estimate[i] for i in ids]) / length(truth[ids]))
    return error, w['length_sigma'] / w['length']


windows = np.array([window(w) for w in drive['windows']
                    if w['first'] in estimate and w['last'] in estimate])
mean = windows[:, 0].mean()
own = windows[:, 1]**2 - drive['common_sigma']**2
p = np.array([estimate[i][:3, 3] for i in posed])
q = np.array([truth[i][:3, 3] for i in posed])


def umeyama(scaled):
    """Least squares similarity of Umeyama, PAMI 1991."""
    a, b = p - p.mean(0), q - q.mean(0)
    u, d, v = np.linalg.svd(b.T @ a / len(p))
    s = np.array([1, 1, np.sign(np.linalg.det(u) * np.linalg.det(v))])
    r = u @ np.diag(s) @ v
    c = (d * s).sum() / (a**2).sum() * len(p) if scaled else 1.0
    return c, c * r, q.mean(0) - c * r @ p.mean(0)


def aligned(scale, linear, shift):
    ate = np.linalg.norm(p @ linear.T + shift - q, axis=1)
    steps = []
    for i, j in zip(posed, posed[1:]):
        e = inverse(estimate[i]) @ estimate[j]
        e[:3, 3] *= scale
        e = inverse(inverse(truth[i]) @ truth[j]) @ e
        steps.append((np.linalg.norm(e[:3, 3]), angle(e)))
    rpe = np.sqrt(np.mean(np.square(steps), axis=0))
    return {'scale': scale, 'ate': {'rmse': np.sqrt(np.mean(ate**2)), 'mean': ate.mean(),
                                    'median': np.median(ate), 'max': ate.max()},
            'rpe_translation_rmse': rpe[0], 'rpe_rotation_rmse_deg': np.degrees(rpe[1])}


joined = truth[posed[0]] @ inverse(estimate[posed[0]])
whole = np.log(length([estimate[i] for i in posed]) / length(truth[posed]))
sigma = drive['length_sigma'] / drive['length']
print(json.dumps({
    'share_with_pose': len(posed) / len(taken),
    'length': length([estimate[i] for i in posed]), 'true_length': length(truth[posed]),
    'length_log_error': whole, 'length_error_sigma': whole / sigma,
    'kitti_every_10th': kitti(10), 'kitti_every_frame': kitti(1),
    'windows': {'count': len(windows), 'mean_log_error': mean,
                'std_log_error': windows[:, 0].std(ddof=1),
                'p95_abs_log_error': np.quantile(np.abs(windows[:, 0]), 0.95),
                'within_2_percent': np.mean(np.abs(windows[:, 0]) <= 0.02),
                'within_2_sigma': np.mean(np.abs(windows[:, 0]) <= 2 * windows[:, 1]),
                'own_spread': np.sqrt(((windows[:, 0] - mean)**2 / own).sum() / (len(own) - 1))},
    'unaligned': aligned(1.0, joined[:3, :3], joined[:3, 3]),
    'rigid': aligned(*umeyama(False)), 'with_scale': aligned(*umeyama(True))}))
