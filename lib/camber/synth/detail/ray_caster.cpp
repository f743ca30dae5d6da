#include "camber/synth/detail/ray_caster.h"

#include <embree3/rtcore.h>

#include <Eigen/Geometry>
#include <new>

#include "camber/core/errors.h"
#include "camber/synth/detail/embree_tree.h"

namespace camber {
namespace {

using embree::check;
using embree::commit;
using embree::Device;
using embree::new_tree;
using embree::Tree;

constexpr int kPacket = 8;
constexpr unsigned kGroundMask = 1u, kRisenMask = 2u;
constexpr float kNearest = 1e-6f, kFarthest = 1e4f;

/// Adds triangles to a tree, as its geometry `id`.
void add_triangles(RTCDevice device, RTCScene tree, const SynthTriangle* triangles,
                   std::size_t count, unsigned mask, unsigned id) {
  if (count == 0) return;
  RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
  auto* vertices = static_cast<float*>(rtcSetNewGeometryBuffer(
      geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float), 3 * count));
  auto* indices = static_cast<unsigned*>(rtcSetNewGeometryBuffer(
      geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 3 * sizeof(unsigned), count));
  if (!vertices || !indices) {
    rtcReleaseGeometry(geometry);
    check(device);
    throw std::bad_alloc();
  }
  for (std::size_t i = 0; i < count; ++i) {
    for (int k = 0; k < 3; ++k) {
      for (int a = 0; a < 3; ++a) {
        vertices[9 * i + 3 * k + a] = static_cast<float>(triangles[i].points[k][a]);
      }
      indices[3 * i + k] = static_cast<unsigned>(3 * i) + k;
    }
  }
  rtcSetGeometryMask(geometry, mask);
  rtcCommitGeometry(geometry);
  rtcAttachGeometryByID(tree, geometry, id);
  rtcReleaseGeometry(geometry);
}

void attach(RTCDevice device, RTCScene frame, RTCScene part, const SE3& pose, unsigned id) {
  RTCGeometry instance = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_INSTANCE);
  rtcSetGeometryInstancedScene(instance, part);
  const Eigen::Matrix<float, 3, 4, Eigen::RowMajor> matrix =
      pose.matrix().topRows<3>().cast<float>();
  rtcSetGeometryTransform(instance, 0, RTC_FORMAT_FLOAT3X4_ROW_MAJOR, matrix.data());
  rtcSetGeometryMask(instance, kGroundMask | kRisenMask);
  rtcCommitGeometry(instance);
  rtcAttachGeometryByID(frame, instance, id);
  rtcReleaseGeometry(instance);
}

void set_ray(RTCRay8* rays, int i, const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
             float nearest, float farthest, unsigned mask) {
  rays->org_x[i] = static_cast<float>(origin.x());
  rays->org_y[i] = static_cast<float>(origin.y());
  rays->org_z[i] = static_cast<float>(origin.z());
  rays->dir_x[i] = static_cast<float>(direction.x());
  rays->dir_y[i] = static_cast<float>(direction.y());
  rays->dir_z[i] = static_cast<float>(direction.z());
  rays->tnear[i] = nearest;
  rays->tfar[i] = farthest;
  rays->time[i] = 0.0f;
  rays->mask[i] = mask;
  rays->id[i] = 0;
  rays->flags[i] = 0;
}

RTCIntersectContext make_context(RTCIntersectContextFlags flags) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = flags;
  return context;
}

}  // namespace

struct RayCaster::Impl {
  Device device;
  std::size_t num_ground = 0;
  Tree still;  ///< geometry 0 ground, 1 things
  std::vector<Tree> cars;
  std::vector<Tree> frames;                          ///< instances: 0 still, 1 + i car i
  std::vector<std::vector<SE3>> vehicle_from_world;  ///< [frame][car]
};

RayCaster::RayCaster(const SynthMesh& ground_and_things, std::size_t num_ground,
                     const std::vector<SynthCar>& cars, int num_frames)
    : impl_(std::make_unique<Impl>()) {
  Impl& in = *impl_;
  in.device = embree::new_device();
  RTCDevice device = in.device.get();
  const auto& triangles = ground_and_things.triangles;
  in.num_ground = num_ground;
  in.still = new_tree(device);
  add_triangles(device, in.still.get(), triangles.data(), num_ground, kGroundMask, 0);
  add_triangles(device, in.still.get(), triangles.data() + num_ground,
                triangles.size() - num_ground, kRisenMask, 1);
  commit(device, in.still.get());
  for (const SynthCar& car : cars) {
    Tree tree = new_tree(device);
    add_triangles(device, tree.get(), car.mesh.triangles.data(), car.mesh.triangles.size(),
                  kRisenMask, 0);
    commit(device, tree.get());
    in.cars.push_back(std::move(tree));
  }
  for (int f = 0; f < num_frames; ++f) {
    Tree frame = new_tree(device);
    attach(device, frame.get(), in.still.get(), SE3(), 0);
    in.vehicle_from_world.emplace_back();
    for (std::size_t i = 0; i < cars.size(); ++i) {
      const SE3& pose = cars[i].world_from_vehicle[f];
      attach(device, frame.get(), in.cars[i].get(), pose, static_cast<unsigned>(1 + i));
      in.vehicle_from_world.back().push_back(pose.inverse());
    }
    commit(device, frame.get());
    in.frames.push_back(std::move(frame));
  }
}

RayCaster::~RayCaster() = default;

void RayCaster::nearest(int frame, const Eigen::Vector3d* origins, bool own_origins,
                        const Eigen::Vector3d* directions, std::size_t count, Hit* hits) const {
  RTCIntersectContext context = make_context(RTC_INTERSECT_CONTEXT_FLAG_COHERENT);
  const auto num_ground = static_cast<int>(impl_->num_ground);
  for (std::size_t first = 0; first < count; first += kPacket) {
    RTCRayHit8 packet;
    alignas(32) int valid[kPacket];
    for (int i = 0; i < kPacket; ++i) {
      const bool there = first + i < count;
      valid[i] = there ? -1 : 0;
      const std::size_t at = there ? first + i : first;
      set_ray(&packet.ray, i, origins[own_origins ? at : 0], directions[at], kNearest, kFarthest,
              kGroundMask | kRisenMask);
      packet.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
      packet.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
    }
    rtcIntersect8(valid, impl_->frames[frame].get(), &context, &packet);
    for (int i = 0; i < kPacket && first + i < count; ++i) {
      Hit& hit = hits[first + i];
      hit = {};
      if (packet.hit.geomID[i] == RTC_INVALID_GEOMETRY_ID) continue;
      const auto part = static_cast<int>(packet.hit.instID[0][i]);
      hit.distance = packet.ray.tfar[i];
      hit.car = part - 1;
      hit.triangle = static_cast<int>(packet.hit.primID[i]);
      if (part == 0 && packet.hit.geomID[i] == 1) hit.triangle += num_ground;
    }
  }
}

void RayCaster::shaded(int frame, const Eigen::Vector3d* origins, const Eigen::Vector3d* directions,
                       std::size_t count, double farthest, std::uint8_t* out) const {
  RTCIntersectContext context = make_context(RTC_INTERSECT_CONTEXT_FLAG_COHERENT);
  for (std::size_t first = 0; first < count; first += kPacket) {
    RTCRay8 packet;
    alignas(32) int valid[kPacket];
    for (int i = 0; i < kPacket; ++i) {
      const bool there = first + i < count;
      valid[i] = there ? -1 : 0;
      const std::size_t at = there ? first + i : first;
      set_ray(&packet, i, origins[at], directions[at], 0.0f, static_cast<float>(farthest),
              kRisenMask);
    }
    rtcOccluded8(valid, impl_->frames[frame].get(), &context, &packet);
    for (int i = 0; i < kPacket && first + i < count; ++i) {
      out[first + i] = packet.tfar[i] < 0.0f ? 1 : 0;
    }
  }
}

bool RayCaster::meets_car(int frame, int car, const Eigen::Vector3d& origin,
                          const Eigen::Vector3d& direction) const {
  RTCIntersectContext context = make_context(RTC_INTERSECT_CONTEXT_FLAG_NONE);
  const SE3& pose = impl_->vehicle_from_world[frame][car];
  const Eigen::Vector3d o = pose * origin, d = pose.rotation() * direction;
  RTCRay ray;
  ray.org_x = static_cast<float>(o.x());
  ray.org_y = static_cast<float>(o.y());
  ray.org_z = static_cast<float>(o.z());
  ray.dir_x = static_cast<float>(d.x());
  ray.dir_y = static_cast<float>(d.y());
  ray.dir_z = static_cast<float>(d.z());
  ray.tnear = 0.0f;
  ray.tfar = kFarthest;
  ray.time = 0.0f;
  ray.mask = ~0u;
  ray.id = 0;
  ray.flags = 0;
  rtcOccluded1(impl_->cars[car].get(), &context, &ray);
  return ray.tfar < 0.0f;
}

}  // namespace camber
