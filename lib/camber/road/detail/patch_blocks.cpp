#include "camber/road/detail/patch_blocks.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <mutex>
#include <tuple>
#include <unordered_map>

#include "camber/core/threads.h"
#include "camber/road/unmodelled.h"

namespace camber::detail {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;
namespace kernels = plane_kernels;

namespace {

// --- points of blocks ---------------------------------------------------------------------------

constexpr double kSteps = 1024.0;                                       // a metre
constexpr auto kSide = static_cast<std::int64_t>(kBlockSide * kSteps);  // of a block
constexpr auto kHalo = static_cast<std::int64_t>(kBlockHalo * kSteps);
constexpr std::int64_t kBeside = std::int64_t{4} * 1024;     // steps, see PatchBlock::beside
constexpr std::int64_t kMostHeight = std::int64_t{1} << 24;  // steps that a float holds exactly
constexpr std::size_t kMostBeside = 8192;                    // points beside a border, about

using Steps = std::array<std::int64_t, 3>;
using Place = std::pair<std::int64_t, std::int64_t>;  // row, column

/// std::floor() of what an integer holds; a call of the mathematical library on old processors.
std::int64_t floor_of(double value) {
  const auto whole = static_cast<std::int64_t>(value);
  return whole - (static_cast<double>(whole) > value ? 1 : 0);
}

/// By whole millimetres: surveys are made of these, and a float's last bit turns none over.
bool steps_of(const RoadCloud& cloud, std::size_t i, Steps* out) {
  for (std::size_t a = 0; a < 3; ++a) {
    const auto axis = static_cast<Eigen::Index>(a);
    const double value = cloud.origin[axis] + static_cast<double>(cloud.points[i][axis]);
    if (!(std::abs(value) < 1e12)) return false;
    const auto millimetres = static_cast<double>(floor_of(value * 1000.0 + 0.5));
    (*out)[a] = floor_of(millimetres * (kSteps / 1000.0) + 0.5);
  }
  return true;
}

std::int64_t block_of(std::int64_t step) {
  return step >= 0 ? step / kSide : -((-step + kSide - 1) / kSide);
}

struct PlaceHash {
  std::size_t operator()(const Place& p) const {
    return static_cast<std::size_t>(static_cast<std::uint64_t>(p.first) * 0x9E3779B97F4A7C15ull ^
                                    static_cast<std::uint64_t>(p.second));
  }
};

/// A point of a block, in steps from its corner.
struct BlockPoint {
  std::int32_t x, y;
  std::int64_t z;
  std::uint32_t index;
};

/// Of a block the points, ascending: those in it, and those in its halo.
struct PointList {
  std::vector<std::uint32_t> own, around;
};
using PointLists = std::unordered_map<Place, PointList, PlaceHash>;

PointLists sort_into_blocks(const RoadCloud& cloud) {
  PointLists out;
  PointList* list = nullptr;
  Place last{0, 0};
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    Steps s;
    if (!steps_of(cloud, i, &s)) continue;
    const Place place{block_of(s[1]), block_of(s[0])};
    if (!list || place != last) {
      list = &out[place];  // stays where it is
      last = place;
    }
    const auto index = static_cast<std::uint32_t>(i);
    list->own.push_back(index);
    // Which neighbours' halos it lies in.
    const std::int64_t x = s[0] - place.second * kSide, y = s[1] - place.first * kSide;
    const int east = x < kHalo            ? -1
                     : x >= kSide - kHalo ? 1
                                          : 0,
              north = y < kHalo            ? -1
                      : y >= kSide - kHalo ? 1
                                           : 0;
    if (east != 0) out[{place.first, place.second + east}].around.push_back(index);
    if (north != 0) out[{place.first + north, place.second}].around.push_back(index);
    if (east != 0 && north != 0) {
      out[{place.first + north, place.second + east}].around.push_back(index);
    }
  }
  return out;
}

/// A point of a block by its place: y, x and height above the block's zero are the code's bits.
struct CodedPoint {
  std::uint64_t code;
  std::uint32_t index;
};
constexpr int kPlanBits = 18, kHeightBits = 24;
static_assert(kSide + 2 * kHalo <= std::int64_t{1} << kPlanBits);
static_assert(kMostHeight == std::int64_t{1} << kHeightBits);

/// By code, then index: points that lie alike are in one of a few lines of y, which are nearly all
/// of some ten points.
void sort_by_place(std::vector<CodedPoint>* points) {
  constexpr int kShift = kPlanBits + kHeightBits + 2;  // lines of 4 steps
  const auto line = [](const CodedPoint& p) { return static_cast<std::size_t>(p.code >> kShift); };
  std::vector<std::uint32_t> starts((std::size_t{1} << (kPlanBits - 2)) + 1, 0);
  for (const CodedPoint& p : *points) ++starts[line(p) + 1];
  for (std::size_t k = 1; k < starts.size(); ++k) starts[k] += starts[k - 1];
  std::vector<CodedPoint> sorted(points->size());
  for (const CodedPoint& p : *points) sorted[starts[line(p)]++] = p;
  // The starts are now the ends.
  std::size_t begin = 0;
  for (const std::uint32_t end : starts) {
    if (end > begin + 1) {
      std::sort(sorted.begin() + static_cast<std::ptrdiff_t>(begin),
                sorted.begin() + static_cast<std::ptrdiff_t>(end),
                [](const CodedPoint& l, const CodedPoint& r) {
                  return l.code < r.code || (l.code == r.code && l.index < r.index);
                });
    }
    begin = std::max<std::size_t>(begin, end);
  }
  points->swap(sorted);
}

/// The block's points and those around it, but for what lies far above the lowest (of nothing on
/// Earth), by y, x, height. @param height  out: steps, a multiple of a block's side below all
std::vector<BlockPoint> gather(const RoadCloud& cloud, const PointList& list, const Place& place,
                               std::int64_t* height) {
  struct Found {
    std::uint64_t plan;
    std::int64_t z;
  };
  const std::size_t count = list.own.size() + list.around.size();
  std::vector<Found> found;
  found.reserve(count);
  std::int64_t lowest = std::numeric_limits<std::int64_t>::max();
  for (const std::vector<std::uint32_t>* const rows : {&list.own, &list.around}) {
    for (const std::uint32_t i : *rows) {
      Steps s{};
      steps_of(cloud, i, &s);
      found.push_back({static_cast<std::uint64_t>(s[1] - place.first * kSide + kHalo) << kPlanBits |
                           static_cast<std::uint64_t>(s[0] - place.second * kSide + kHalo),
                       s[2]});
      lowest = std::min(lowest, s[2]);
    }
  }
  *height = block_of(lowest) * kSide;
  std::vector<CodedPoint> points;
  points.reserve(count);
  for (std::size_t k = 0; k < count; ++k) {
    if (found[k].z - *height >= kMostHeight) continue;
    points.push_back(
        {found[k].plan << kHeightBits | static_cast<std::uint64_t>(found[k].z - *height),
         k < list.own.size() ? list.own[k] : list.around[k - list.own.size()]});
  }
  sort_by_place(&points);
  std::vector<BlockPoint> out;
  out.reserve(points.size());
  constexpr std::uint64_t kPlan = (std::uint64_t{1} << kPlanBits) - 1,
                          kHeight = (std::uint64_t{1} << kHeightBits) - 1;
  for (const CodedPoint& p : points) {
    out.push_back({static_cast<std::int32_t>(
                       static_cast<std::int64_t>(p.code >> kHeightBits & kPlan) - kHalo),
                   static_cast<std::int32_t>(
                       static_cast<std::int64_t>(p.code >> (kHeightBits + kPlanBits)) - kHalo),
                   *height + static_cast<std::int64_t>(p.code & kHeight), p.index});
  }
  return out;
}

std::uint64_t hash_of(const BlockPoint& p, const Place& place) {
  std::uint64_t z = static_cast<std::uint64_t>(place.second * kSide + p.x) * 0x9E3779B97F4A7C15ull +
                    static_cast<std::uint64_t>(place.first * kSide + p.y) * 0xD1B54A32D192ED03ull +
                    static_cast<std::uint64_t>(p.z) * 0x8CB92BA72F3D8DD7ull;
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ull;
  z = (z ^ (z >> 27)) * 0x94D049BB133111EBull;
  return z ^ (z >> 31);
}

/// The labels of the points beside each side; of many about kMostBeside, drawn by place.
std::array<std::vector<std::int32_t>, 4> labels_beside(const std::vector<BlockPoint>& points,
                                                       const Place& place,
                                                       const std::vector<int>& labels) {
  std::array<std::vector<std::size_t>, 4> all;
  const auto near = [](std::int64_t value, std::int64_t side) {
    return value >= side - kBeside && value < side + kBeside;
  };
  const auto within = [](std::int64_t value) { return value >= 0 && value < kSide; };
  for (std::size_t k = 0; k < points.size(); ++k) {
    const BlockPoint& p = points[k];
    if (within(p.y) && near(p.x, 0)) all[0].push_back(k);
    if (within(p.y) && near(p.x, kSide)) all[1].push_back(k);
    if (within(p.x) && near(p.y, 0)) all[2].push_back(k);
    if (within(p.x) && near(p.y, kSide)) all[3].push_back(k);
  }
  std::array<std::vector<std::int32_t>, 4> out;
  for (std::size_t side = 0; side < 4; ++side) {
    const std::size_t count = all[side].size();
    const std::uint64_t most =
        count <= kMostBeside ? ~std::uint64_t{0} : ~std::uint64_t{0} / count * kMostBeside;
    for (const std::size_t k : all[side]) {
      if (hash_of(points[k], place) <= most) out[side].push_back(labels[k]);
    }
  }
  return out;
}

RoadCloud cloud_of(const RoadCloud& cloud, const std::vector<BlockPoint>& points,
                   std::int64_t height) {
  RoadCloud out;
  out.frame = cloud.frame;
  out.metric = true;
  constexpr float kStep = 1.0f / 1024.0f;
  out.points.reserve(points.size());
  if (!cloud.sigmas.empty()) out.sigmas.reserve(points.size());
  if (!cloud.covariances.empty()) out.covariances.reserve(points.size());
  for (const BlockPoint& p : points) {
    out.points.emplace_back(static_cast<float>(p.x) * kStep, static_cast<float>(p.y) * kStep,
                            static_cast<float>(p.z - height) * kStep);
    if (!cloud.sigmas.empty()) out.sigmas.push_back(cloud.sigmas[p.index]);
    if (!cloud.covariances.empty()) out.covariances.push_back(cloud.covariances[p.index]);
  }
  return out;
}

/// @param labels  by points of the cloud: the piece of the block's own points
PatchBlock fit_block(const RoadCloud& cloud, const PointList& list, const Place& place,
                     const RoadSurfaceOptions& options, std::vector<int>* labels) {
  PatchBlock out;
  out.row = place.first;
  out.column = place.second;
  std::int64_t height = 0;
  const std::vector<BlockPoint> points = gather(cloud, list, place, &height);
  out.height = static_cast<double>(height) / kSteps;
  const RoadCloud block = cloud_of(cloud, points, height);
  CloudPart part;
  part.most_points = kMostBlockPoints;
  part.box = Eigen::AlignedBox2d(Vector2d::Zero(), Vector2d::Constant(kBlockSide));
  part.own.reserve(points.size());
  for (const BlockPoint& p : points) {
    part.own.push_back(p.x >= 0 && p.x < kSide && p.y >= 0 && p.y < kSide ? 1 : 0);
  }
  std::optional<Vector3d> viewpoint = options.viewpoint;
  if (viewpoint) {
    *viewpoint -= Vector3d(static_cast<double>(place.second) * kBlockSide,
                           static_cast<double>(place.first) * kBlockSide, out.height);
  }
  PatchLayer layer =
      find_patch_layers(block, Vector3d::UnitZ(), viewpoint, options, &part, [](double) {});
  out.reason = layer.reason;
  out.tolerance = std::max(options.tolerance_sigmas * layer.typical, options.tolerance);
  out.local_noise = layer.local_noise;
  out.borders = std::move(layer.borders);
  out.sums = std::move(layer.sums);
  RoadSurface surface;
  surface.metric = true;
  surface.up = Vector3d::UnitZ();
  surface.patches = std::move(layer.patches);
  camber::measure_unmodelled(block, layer.labels, &surface);
  out.pieces = std::move(surface.patches);
  for (PlanePatch& piece : out.pieces) {
    piece.inliers = 0;
    piece.boundary.clear();
  }
  for (std::size_t k = 0; k < points.size(); ++k) {
    if (!part.own[k]) continue;
    (*labels)[points[k].index] = layer.labels[k];
    if (layer.labels[k] >= 0) ++out.pieces[static_cast<std::size_t>(layer.labels[k])].inliers;
  }
  out.beside = labels_beside(points, place, layer.labels);
  return out;
}

// --- planes of several pieces -------------------------------------------------------------------

/// A plane with axes on it.
struct PlaneFrame {
  Vector3d center, a, b, n;

  /// How high the plane of another frame lies above this one: h + hu u + hv v at its place (u, v).
  Vector3d height_of(const PlaneFrame& o) const {
    return {n.dot(o.center - center), n.dot(o.a), n.dot(o.b)};
  }
  /// (1, u, v) here of (1, u, v) there.
  Matrix3d places_of(const PlaneFrame& o) const {
    const Vector3d way = o.center - center;
    Matrix3d out;
    out << 1.0, 0.0, 0.0, a.dot(way), a.dot(o.a), a.dot(o.b), b.dot(way), b.dot(o.a), b.dot(o.b);
    return out;
  }
};

Matrix3d symmetric(double one, double u, double v, double uu, double uv, double vv) {
  Matrix3d out;
  out << one, u, v, u, uu, uv, v, uv, vv;
  return out;
}

/// A piece among all, or what several have together, relative to one corner.
struct Member {
  PlaneFrame frame;
  Matrix3d normal;  // normal equations in (1, u, v), of the block's own points
  Vector3d right;
  double weight = 0.0;
  double allowed = 0.0;  // cost of the tolerance
  // Of a piece:
  const PatchSums* sums = nullptr;
  const PlanePatch* piece = nullptr;
  Vector3d offset = Vector3d::Zero();  // of the block's corner

  /// How much more the points cost on another plane than on their own.
  double cost(const PlaneFrame& plane) const {
    const Vector3d d = plane.height_of(frame);
    return 2.0 * right.dot(d) + d.dot(normal * d);
  }
};

/// The plane of several pieces by their summed normal equations.
PlaneFrame fit_members(const std::vector<Member>& members, const std::vector<int>& list) {
  const auto at = [&](int k) -> const Member& { return members[static_cast<std::size_t>(k)]; };
  int heaviest = list.front();
  double weight = 0.0;
  Vector3d middle = Vector3d::Zero();
  for (const int k : list) {
    if (at(k).weight > at(heaviest).weight) heaviest = k;
    weight += at(k).weight;
    const Vector3d mean = at(k).weight > 0.0 ? Vector3d(at(k).normal.col(0) / at(k).normal(0, 0))
                                             : Vector3d(1.0, 0.0, 0.0);
    middle +=
        at(k).weight * (at(k).frame.center + mean[1] * at(k).frame.a + mean[2] * at(k).frame.b);
  }
  PlaneFrame out = at(heaviest).frame;
  if (!(weight > 0.0) || list.size() == 1) return out;
  out.center = middle / weight;
  constexpr int kRounds = 3;
  for (int round = 0; round < kRounds; ++round) {
    Matrix3d left = Matrix3d::Zero();
    Vector3d right = Vector3d::Zero();
    for (const int k : list) {
      if (!(at(k).weight > 0.0)) continue;
      const Matrix3d places = out.places_of(at(k).frame);
      left += places * at(k).normal * places.transpose();
      right += places * (at(k).normal * out.height_of(at(k).frame) + at(k).right);
    }
    const Vector3d change = left.ldlt().solve(right);
    if (!change.allFinite()) return out;
    out.center += change[0] * out.n;
    const Vector3d n = (out.n - change[1] * out.a - change[2] * out.b).normalized();
    out.a = (out.a - out.a.dot(n) * n).normalized();
    out.b = n.cross(out.a);
    out.n = n;
  }
  return out;
}

/// Two members as one on their common plane.
Member sum_of(const Member& a, const Member& b, const PlaneFrame& plane) {
  Member out;
  out.frame = plane;
  out.normal.setZero();
  out.right.setZero();
  for (const Member* m : {&a, &b}) {
    const Matrix3d places = plane.places_of(m->frame);
    out.normal += places * m->normal * places.transpose();
    out.right += places * (m->right + m->normal * plane.height_of(m->frame));
    out.weight += m->weight;
    out.allowed += m->allowed;
  }
  return out;
}

/// Groups of pieces that lie on one plane.
class Groups {
 public:
  explicit Groups(const std::vector<Member>& pieces) : pieces_(pieces), sums_(pieces) {
    for (std::size_t k = 0; k < pieces.size(); ++k) {
      group_.push_back(static_cast<int>(k));
      lists_.push_back({static_cast<int>(k)});
    }
  }

  void join(int i, int j) {
    auto a = static_cast<std::size_t>(group_[static_cast<std::size_t>(i)]),
         b = static_cast<std::size_t>(group_[static_cast<std::size_t>(j)]);
    if (a == b) return;
    if (b < a) std::swap(a, b);
    const PlaneFrame plane = fit_members({sums_[a], sums_[b]}, {0, 1});
    if (!fits(a, plane) || !fits(b, plane)) return;
    sums_[a] = sum_of(sums_[a], sums_[b], plane);
    for (const int k : lists_[b]) group_[static_cast<std::size_t>(k)] = static_cast<int>(a);
    std::vector<int>& list = lists_[a];
    const auto middle = static_cast<std::ptrdiff_t>(list.size());
    list.insert(list.end(), lists_[b].begin(), lists_[b].end());
    std::inplace_merge(list.begin(), list.begin() + middle, list.end());
    lists_[b] = {};
  }

  /// Its pieces, ascending; the first has the group's number.
  const std::vector<int>& list(int group) const { return lists_[static_cast<std::size_t>(group)]; }
  int group(std::size_t piece) const { return group_[piece]; }

 private:
  /// As RegionPartition joins regions: a plane of its own must save so much, and a third of the
  /// tolerance is allowed over a side, all of it over a piece.
  bool fits(std::size_t group, const PlaneFrame& plane) const {
    constexpr double kNewPlane = 10.0, kShare = 1.0 / 9.0;
    const Member& side = sums_[group];
    if (side.cost(plane) > kNewPlane + kShare * side.allowed) return false;
    return std::all_of(lists_[group].begin(), lists_[group].end(), [&](int k) {
      const Member& piece = pieces_[static_cast<std::size_t>(k)];
      return piece.cost(plane) <= kNewPlane + piece.allowed;
    });
  }

  const std::vector<Member>& pieces_;
  std::vector<Member> sums_;  // of each group
  std::vector<int> group_;
  std::vector<std::vector<int>> lists_;
};

/// Two pieces that hold the same points beside a border.
struct Meeting {
  int count = 0, a = 0, b = 0;
};

/// @param first  number of each block's first piece
std::vector<Meeting> find_meetings(const std::vector<PatchBlock>& blocks,
                                   const std::vector<int>& first) {
  std::unordered_map<Place, std::size_t, PlaceHash> index;
  for (std::size_t k = 0; k < blocks.size(); ++k) index[{blocks[k].row, blocks[k].column}] = k;
  std::vector<Meeting> out;
  const auto compare = [&](std::size_t from, std::size_t to, std::size_t side, std::size_t other) {
    const std::vector<std::int32_t>&here = blocks[from].beside[side],
          &there = blocks[to].beside[other];
    std::map<std::pair<int, int>, int> both;
    std::vector<int> mine(blocks[from].pieces.size(), 0), theirs(blocks[to].pieces.size(), 0);
    for (std::size_t k = 0; k < std::min(here.size(), there.size()); ++k) {
      if (here[k] >= 0) ++mine[static_cast<std::size_t>(here[k])];
      if (there[k] >= 0) ++theirs[static_cast<std::size_t>(there[k])];
      if (here[k] >= 0 && there[k] >= 0) ++both[{here[k], there[k]}];
    }
    constexpr int kFewest = 3;  // points, that fix a plane
    for (const auto& [pair, count] : both) {
      const int smaller = std::min(mine[static_cast<std::size_t>(pair.first)],
                                   theirs[static_cast<std::size_t>(pair.second)]);
      if (count < kFewest || 2 * count < smaller) continue;
      out.push_back({count, first[from] + pair.first, first[to] + pair.second});
    }
  };
  for (std::size_t k = 0; k < blocks.size(); ++k) {
    const auto east = index.find({blocks[k].row, blocks[k].column + 1}),
               north = index.find({blocks[k].row + 1, blocks[k].column});
    if (east != index.end()) compare(k, east->second, 1, 0);
    if (north != index.end()) compare(k, north->second, 3, 2);
  }
  std::sort(out.begin(), out.end(), [](const Meeting& l, const Meeting& r) {
    return std::make_tuple(-l.count, l.a, l.b) < std::make_tuple(-r.count, r.a, r.b);
  });
  return out;
}

/// All pieces, relative to the first block's corner.
std::vector<Member> list_members(const std::vector<PatchBlock>& blocks) {
  std::vector<Member> out;
  for (const PatchBlock& block : blocks) {
    const Vector3d offset(static_cast<double>(block.column - blocks.front().column) * kBlockSide,
                          static_cast<double>(block.row - blocks.front().row) * kBlockSide,
                          block.height - blocks.front().height);
    for (std::size_t k = 0; k < block.pieces.size(); ++k) {
      const PatchSums& sums = block.sums[k];
      const kernels::Moments& m = sums.fit;
      Member member;
      member.frame = {sums.center + offset, sums.a, sums.b, sums.normal};
      member.normal = symmetric(m.weight, m.u, m.v, m.uu, m.uv, m.vv);
      member.right = {m.r, m.ru, m.rv};
      member.weight = m.weight;
      member.allowed = m.weight * block.tolerance * block.tolerance;
      member.sums = &sums;
      member.piece = &block.pieces[k];
      member.offset = offset;
      out.push_back(member);
    }
  }
  return out;
}

/// The estimate on a plane of several pieces that have points.
PlaneEstimate estimate_group(const std::vector<Member>& members, const std::vector<int>& list,
                             const PlaneFrame& plane) {
  kernels::Moments full;
  Matrix3d matrix = Matrix3d::Zero(), psi = Matrix3d::Zero();
  PlanePointErrors errors;
  UnknownRays rays;
  double count = 0.0, noise = 0.0, shared = 0.0, seen = 0.0;
  for (const int k : list) {
    const Member& member = members[static_cast<std::size_t>(k)];
    const kernels::Moments& m = member.sums->influence;
    const Matrix3d places = plane.places_of(member.frame);
    matrix += places * symmetric(m.weight, m.u, m.v, m.uu, m.uv, m.vv) * places.transpose();
    psi += places * symmetric(m.i1, m.iu, m.iv, m.iuu, m.iuv, m.ivv) * places.transpose();
    count += m.count;
    errors.places += member.sums->errors.places;
    const double own = member.sums->errors.noise;
    if (std::isfinite(own)) noise += m.count * own * own;
    shared += m.count * member.sums->errors.shared * member.sums->errors.shared;
    if (!member.sums->rays) continue;
    const UnknownRays& of = *member.sums->rays;
    seen += m.count;
    rays.rise += m.count * of.rise;
    const double slopes = 0.5 * (of.slope_u * of.slope_u + of.slope_v * of.slope_v);
    rays.slope_u += m.count * slopes;
  }
  full.weight = matrix(0, 0);
  full.u = matrix(0, 1);
  full.v = matrix(0, 2);
  full.uu = matrix(1, 1);
  full.uv = matrix(1, 2);
  full.vv = matrix(2, 2);
  full.i1 = psi(0, 0);
  full.iu = psi(0, 1);
  full.iv = psi(0, 2);
  full.iuu = psi(1, 1);
  full.iuv = psi(1, 2);
  full.ivv = psi(2, 2);
  full.count = count;
  errors.noise = std::sqrt(noise / std::max(count, 1e-300));
  errors.shared = std::sqrt(shared / std::max(count, 1e-300));
  std::optional<UnknownRays> unknown;
  if (seen > 0.0) {
    rays.rise /= seen;
    rays.slope_u = rays.slope_v = std::sqrt(rays.slope_u / seen);
    unknown = rays;
  }
  PivotPlane pivot;
  pivot.n = plane.n;
  pivot.d = -plane.n.dot(plane.center);
  PlaneWindow window;
  window.center = plane.center;
  window.a = plane.a;
  window.b = plane.b;
  return estimate_covariance(pivot, window, full, full, errors, Vector3d::UnitZ(), unknown);
}

/// The patch of a group, relative to `corner`; no outline: it has hardly any points.
PlanePatch patch_of(const std::vector<Member>& members, const std::vector<int>& list,
                    const PlaneFrame& plane, const Vector3d& corner) {
  std::vector<int> weighty;
  PlanePatch out;
  std::vector<Vector2d> corners;
  for (const int k : list) {
    const Member& member = members[static_cast<std::size_t>(k)];
    out.inliers += member.piece->inliers;
    if (member.weight > 0.0) weighty.push_back(k);
    for (const Vector2d& place : member.sums->outline) {
      corners.push_back(place + member.offset.head<2>());
    }
  }
  if (weighty.empty()) return out;
  if (weighty.size() == 1) {
    const Member& member = members[static_cast<std::size_t>(weighty.front())];
    const int inliers = out.inliers;
    out = *member.piece;
    out.inliers = inliers;
    out.plane.centroid += member.offset;
  } else {
    const PlaneEstimate estimate = estimate_group(members, weighty, plane);
    out.status = estimate.status;
    out.reason = estimate.reason;
    out.noise = estimate.noise;
    out.plane = estimate.plane;
  }
  const Vector3d& n = out.plane.plane.normal;
  out.plane.plane = Plane::through(out.plane.centroid, n);
  for (const Vector2d& place : convex_hull(std::move(corners))) {
    const double z = -(n.x() * place.x() + n.y() * place.y() + out.plane.plane.offset) / n.z();
    out.boundary.push_back(Vector3d(place.x(), place.y(), z) + corner);
  }
  if (out.boundary.size() < 3) out.boundary.clear();
  out.plane.centroid += corner;
  out.plane.plane = Plane::through(out.plane.centroid, n);
  return out;
}

Vector3d corner_of(const PatchBlock& block) {
  return {static_cast<double>(block.column) * kBlockSide,
          static_cast<double>(block.row) * kBlockSide, block.height};
}

}  // namespace

PatchBlocks fit_patch_blocks(const RoadCloud& cloud, const std::vector<std::uint8_t>& own,
                             const RoadSurfaceOptions& options, const Progress& progress) {
  const PointLists lists = sort_into_blocks(cloud);
  std::vector<Place> places;
  for (const auto& [place, list] : lists) {
    const auto asked = [&](std::uint32_t i) { return own.empty() || own[i] != 0; };
    if (std::any_of(list.own.begin(), list.own.end(), asked)) places.push_back(place);
  }
  std::sort(places.begin(), places.end());
  PatchBlocks out;
  out.blocks.resize(places.size());
  out.labels.assign(cloud.size(), -1);
  // Blocks side by side keep all threads busy, and one alone lets them work within it.
  RoadSurfaceOptions inside = options;
  if (places.size() > 1) inside.num_threads = 1;
  std::mutex mutex;
  std::size_t done = 0;
  parallel_for(places.size(), options.num_threads, [&](std::size_t k) {
    out.blocks[k] = fit_block(cloud, lists.at(places[k]), places[k], inside, &out.labels);
    if (!progress) return;
    const std::lock_guard<std::mutex> lock(mutex);
    progress("patches", 0.9 * static_cast<double>(++done) / static_cast<double>(places.size()));
  });
  int base = 0;
  for (std::size_t k = 0; k < places.size(); ++k) {
    for (const std::uint32_t i : lists.at(places[k]).own) {
      if (out.labels[i] >= 0) out.labels[i] += base;
    }
    base += static_cast<int>(out.blocks[k].pieces.size());
  }
  return out;
}

JoinedPieces join_patch_blocks(const std::vector<PatchBlock>& blocks,
                               const RoadSurfaceOptions& options) {
  JoinedPieces out;
  const std::vector<Member> members = list_members(blocks);
  std::vector<int> first;
  int pieces = 0;
  for (const PatchBlock& block : blocks) {
    first.push_back(pieces);
    pieces += static_cast<int>(block.pieces.size());
    out.local_noise = std::max(out.local_noise, block.local_noise);
    if (out.reason.empty()) out.reason = block.reason;
  }
  Groups groups(members);
  for (const Meeting& meeting : find_meetings(blocks, first)) groups.join(meeting.a, meeting.b);
  out.patch_of_piece.assign(members.size(), -1);
  for (std::size_t k = 0; k < members.size(); ++k) {
    const int group = groups.group(k);
    if (group != static_cast<int>(k)) continue;
    const std::vector<int>& list = groups.list(group);
    PlanePatch patch =
        patch_of(members, list, fit_members(members, list), corner_of(blocks.front()));
    if (patch.inliers < options.min_patch_points || patch.boundary.empty() ||
        patch.status == Status::kFailed) {
      continue;
    }
    patch.id = static_cast<int>(out.patches.size());
    for (const int piece : list) out.patch_of_piece[static_cast<std::size_t>(piece)] = patch.id;
    out.noise.push_back(static_cast<float>(patch.noise));
    out.patches.push_back(std::move(patch));
  }
  for (std::size_t k = 0; k < blocks.size(); ++k) {
    for (const auto& [pair, number] : blocks[k].borders) {
      const int a = out.patch_of_piece[static_cast<std::size_t>(first[k] + pair.first)],
                b = out.patch_of_piece[static_cast<std::size_t>(first[k] + pair.second)];
      if (a >= 0 && b >= 0 && a != b) out.borders[{std::min(a, b), std::max(a, b)}] += number;
    }
  }
  if (!out.patches.empty()) {
    out.reason.clear();
  } else if (out.reason.empty()) {
    out.reason = "no planar ground was found";
  }
  return out;
}

void measure_unmodelled(const std::vector<PatchBlock>& blocks,
                        const std::vector<int>& patch_of_piece, RoadSurface* surface) {
  std::vector<double> squares(surface->patches.size(), 0.0), weights(squares);
  const std::vector<Member> members = list_members(blocks);
  const Vector3d corner = blocks.empty() ? Vector3d::Zero() : corner_of(blocks.front());
  for (std::size_t k = 0; k < members.size(); ++k) {
    const Member& member = members[k];
    if (patch_of_piece[k] < 0 || !(member.weight > 0.0)) continue;
    const auto at = static_cast<std::size_t>(patch_of_piece[k]);
    const UncertainPlane& plane = surface->patches[at].plane;
    const PlaneFrame frame{plane.centroid - corner, plane.axis1, plane.axis2, plane.plane.normal};
    const Vector3d off = frame.height_of(member.frame);
    squares[at] += member.weight * member.piece->unmodelled_sigma * member.piece->unmodelled_sigma +
                   off.dot(member.normal * off);
    weights[at] += member.weight;
  }
  for (std::size_t k = 0; k < squares.size(); ++k) {
    surface->patches[k].unmodelled_sigma =
        weights[k] > 0.0 ? std::sqrt(std::max(squares[k] / weights[k], 0.0)) : 0.0;
  }
}

}  // namespace camber::detail
