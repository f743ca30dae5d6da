#include "camber/evaluate/triangle_tree.h"

#include <embree3/rtcore.h>
#include <oneapi/tbb/task_arena.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <new>
#include <stdexcept>
#include <string>

#include "camber/cloud/morton.h"
#include "camber/core/errors.h"
#include "camber/core/threads.h"

namespace camber {
namespace {

Eigen::Vector3d nearest_on_segment(const Eigen::Vector3d& p, const Eigen::Vector3d& a,
                                   const Eigen::Vector3d& b) {
  const Eigen::Vector3d ab = b - a;
  const double length = ab.squaredNorm();
  if (!(length > 0.0)) return a;
  return a + std::clamp((p - a).dot(ab) / length, 0.0, 1.0) * ab;
}

void check(RTCDevice device) {
  const RTCError error = rtcGetDeviceError(device);
  if (error == RTC_ERROR_NONE) return;
  if (error == RTC_ERROR_OUT_OF_MEMORY) throw std::bad_alloc();
  throw MachineError("Embree cannot search a mesh: its error " + std::to_string(error));
}

}  // namespace

Eigen::Vector3d nearest_on_triangle(const Eigen::Vector3d& p, const Eigen::Vector3d& a,
                                    const Eigen::Vector3d& b, const Eigen::Vector3d& c) {
  const Eigen::Vector3d ab = b - a, ac = c - a, ap = p - a;
  const double d1 = ab.dot(ap), d2 = ac.dot(ap);
  if (d1 <= 0.0 && d2 <= 0.0) return a;
  const Eigen::Vector3d bp = p - b;
  const double d3 = ab.dot(bp), d4 = ac.dot(bp);
  if (d3 >= 0.0 && d4 <= d3) return b;
  const Eigen::Vector3d cp = p - c;
  const double d5 = ab.dot(cp), d6 = ac.dot(cp);
  if (d6 >= 0.0 && d5 <= d6) return c;
  const double vc = d1 * d4 - d3 * d2, vb = d5 * d2 - d1 * d6, va = d3 * d6 - d5 * d4;
  const double sum = va + vb + vc;
  // Slivers: the areas above are rounding alone.
  const bool flat = !(sum > 1e-14 * ab.squaredNorm() * ac.squaredNorm());
  if (flat || va <= 0.0 || vb <= 0.0 || vc <= 0.0) {
    // On the border; the nearest of the edges that can be it.
    Eigen::Vector3d best = nearest_on_segment(p, a, b);
    double least = (best - p).squaredNorm();
    for (const Eigen::Vector3d& q : {nearest_on_segment(p, b, c), nearest_on_segment(p, c, a)}) {
      const double d = (q - p).squaredNorm();
      if (d < least) {
        least = d;
        best = q;
      }
    }
    return best;
  }
  return a + ab * (vb / sum) + ac * (vc / sum);
}

struct TriangleTree::Impl {
  std::vector<Eigen::Vector3d> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  std::vector<int> searched;  // triangles of the tree, by Embree's number
  RTCDevice device = nullptr;
  RTCScene scene = nullptr;

  ~Impl() {
    if (scene) rtcReleaseScene(scene);
    if (device) rtcReleaseDevice(device);
  }

  void build();
  double squared_distance(int triangle, const Eigen::Vector3d& place) const {
    const auto& t = triangles[static_cast<std::size_t>(triangle)];
    return (nearest_on_triangle(place, vertices[t[0]], vertices[t[1]], vertices[t[2]]) - place)
        .squaredNorm();
  }
};

namespace {

/// A distance within which Embree, which knows the place and the boxes of its tree as floats, must
/// look so that nothing is missed within `distance`.
float reach(double distance, const Eigen::Vector3d& place) {
  // Rounding of the place's coordinates, and of the few operations on them.
  const double slack = 1e-6 * distance + 4e-7 * place.cwiseAbs().maxCoeff();
  return std::nextafter(static_cast<float>(distance + slack),
                        std::numeric_limits<float>::infinity());
}

}  // namespace

TriangleTree::TriangleTree(std::vector<Eigen::Vector3d> vertices,
                           const std::vector<std::array<std::uint32_t, 3>>& triangles)
    : impl_(std::make_unique<Impl>()) {
  impl_->vertices = std::move(vertices);
  impl_->triangles = triangles;
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    bool finite = true;
    for (const std::uint32_t v : triangles[t]) {
      if (v >= impl_->vertices.size()) {
        throw std::invalid_argument("triangle " + std::to_string(t) + ": found vertex " +
                                    std::to_string(v) + ", expected below " +
                                    std::to_string(impl_->vertices.size()));
      }
      finite = finite && impl_->vertices[v].cast<float>().allFinite();
    }
    if (finite) impl_->searched.push_back(static_cast<int>(t));
  }
  if (!impl_->searched.empty()) impl_->build();
}

TriangleTree::~TriangleTree() = default;
TriangleTree::TriangleTree(TriangleTree&& other) noexcept = default;
TriangleTree& TriangleTree::operator=(TriangleTree&& other) noexcept = default;

bool TriangleTree::empty() const { return impl_->searched.empty(); }

void TriangleTree::Impl::build() {
  device = rtcNewDevice(nullptr);
  if (!device) check(nullptr);
  scene = rtcNewScene(device);
  RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
  auto* places = static_cast<float*>(rtcSetNewGeometryBuffer(
      geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float), vertices.size()));
  auto* corners = static_cast<std::uint32_t*>(
      rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                              3 * sizeof(std::uint32_t), searched.size()));
  if (places && corners) {
    for (const Eigen::Vector3d& v : vertices) {
      for (int axis = 0; axis < 3; ++axis) *places++ = static_cast<float>(v[axis]);
    }
    for (const int t : searched) {
      for (const std::uint32_t v : triangles[static_cast<std::size_t>(t)]) *corners++ = v;
    }
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene, geometry);
  }
  rtcReleaseGeometry(geometry);
  check(device);
  // On this thread alone: Embree's own limit of threads would be that of the whole process.
  oneapi::tbb::task_arena arena(1);
  arena.execute([&] { rtcJoinCommitScene(scene); });
  check(device);
}

TriangleTree::Nearest TriangleTree::nearest(const Eigen::Vector3d& place, double limit) const {
  if (empty() || !place.cast<float>().allFinite()) return {};
  struct Search {
    const Impl& tree;
    const Eigen::Vector3d& place;
    Nearest best;
  } search{*impl_, place, {}};
  search.best.squared_distance = limit;
  RTCPointQuery query{};
  query.x = static_cast<float>(place.x());
  query.y = static_cast<float>(place.y());
  query.z = static_cast<float>(place.z());
  query.radius = reach(std::sqrt(limit), place);
  RTCPointQueryContext context;
  rtcInitPointQueryContext(&context);
  const RTCPointQueryFunction measure = [](RTCPointQueryFunctionArguments* found) {
    auto& s = *static_cast<Search*>(found->userPtr);
    const int triangle = s.tree.searched[found->primID];
    const double distance = s.tree.squared_distance(triangle, s.place);
    if (distance > s.best.squared_distance ||
        (distance == s.best.squared_distance && triangle >= s.best.triangle)) {
      return false;
    }
    s.best = {triangle, distance};
    const float radius = reach(std::sqrt(distance), s.place);
    if (!(radius < found->query->radius)) return false;
    found->query->radius = radius;
    return true;  // the radius is another
  };
  rtcPointQuery(impl_->scene, &query, &context, measure, &search);
  return search.best.triangle < 0 ? Nearest{} : search.best;
}

std::vector<TriangleTree::Nearest> TriangleTree::nearest_of_all(
    const std::vector<Eigen::Vector3d>& places, int num_threads) const {
  std::vector<Nearest> out(places.size());
  if (empty()) return out;
  const auto& first = impl_->triangles[static_cast<std::size_t>(impl_->searched[0])];
  std::vector<Eigen::Vector3f> rounded(places.size());
  for (std::size_t i = 0; i < places.size(); ++i) {
    rounded[i] = (places[i] - impl_->vertices[first[0]]).cast<float>();
  }
  const std::vector<int> order = morton_order(rounded);
  constexpr std::size_t kBlock = 4096;
  parallel_for((order.size() + kBlock - 1) / kBlock, num_threads, [&](std::size_t block) {
    int last = -1;  // the last place's triangle is near this one too
    const std::size_t end = std::min(order.size(), (block + 1) * kBlock);
    for (std::size_t i = block * kBlock; i < end; ++i) {
      const Eigen::Vector3d& place = places[static_cast<std::size_t>(order[i])];
      if (!place.allFinite()) continue;
      double limit = std::numeric_limits<double>::infinity();
      if (last >= 0) {
        limit = impl_->squared_distance(last, place) * (1.0 + 1e-12) + 1e-300;
      }
      const Nearest found = nearest(place, limit);
      if (found.triangle < 0) continue;  // too far for numbers
      out[static_cast<std::size_t>(order[i])] = found;
      last = found.triangle;
    }
  });
  return out;
}

Eigen::Vector3d TriangleTree::normal(int triangle) const {
  const auto& t = impl_->triangles[static_cast<std::size_t>(triangle)];
  const auto& v = impl_->vertices;
  const Eigen::Vector3d n = (v[t[1]] - v[t[0]]).cross(v[t[2]] - v[t[0]]);
  const double length = n.norm();
  return length > 0.0 ? Eigen::Vector3d(n / length) : Eigen::Vector3d::Zero();
}

}  // namespace camber
