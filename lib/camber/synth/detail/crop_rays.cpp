#include "camber/synth/detail/crop_rays.h"

#include <new>

namespace camber {
namespace {

constexpr int kPacket = 8;
constexpr unsigned kSeen = 1u, kShadowing = 2u;
constexpr float kNearest = 1e-4f, kFarthest = 1e4f;

RTCIntersectContext coherent_context() {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  return context;
}

void set_ray(RTCRay8* rays, int i, const Eigen::Vector3f& origin, const Eigen::Vector3f& direction,
             unsigned mask) {
  rays->org_x[i] = origin.x();
  rays->org_y[i] = origin.y();
  rays->org_z[i] = origin.z();
  rays->dir_x[i] = direction.x();
  rays->dir_y[i] = direction.y();
  rays->dir_z[i] = direction.z();
  rays->tnear[i] = kNearest;
  rays->tfar[i] = kFarthest;
  rays->time[i] = 0.0f;
  rays->mask[i] = mask;
  rays->id[i] = 0;
  rays->flags[i] = 0;
}

}  // namespace

MeshTree::MeshTree(const embree::Device& device, const CropMesh& mesh, bool casts_shadow)
    : tree_(embree::new_tree(device.get())) {
  if (!mesh.triangles.empty()) {
    RTCGeometry geometry = rtcNewGeometry(device.get(), RTC_GEOMETRY_TYPE_TRIANGLE);
    auto* vertices = static_cast<float*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                3 * sizeof(float), mesh.vertices.size()));
    auto* indices = static_cast<unsigned*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                3 * sizeof(unsigned), mesh.triangles.size()));
    if (!vertices || !indices) {
      rtcReleaseGeometry(geometry);
      embree::check(device.get());
      throw std::bad_alloc();
    }
    for (std::size_t i = 0; i < mesh.vertices.size(); ++i) {
      for (int a = 0; a < 3; ++a) vertices[3 * i + a] = mesh.vertices[i][a];
    }
    for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
      for (int k = 0; k < 3; ++k) {
        indices[3 * i + k] = static_cast<unsigned>(mesh.triangles[i][k]);
      }
    }
    rtcSetGeometryMask(geometry, casts_shadow ? kSeen | kShadowing : kSeen);
    rtcCommitGeometry(geometry);
    rtcAttachGeometryByID(tree_.get(), geometry, 0);
    rtcReleaseGeometry(geometry);
  }
  embree::commit(device.get(), tree_.get());
}

CropRays::CropRays(const embree::Device& device, const std::vector<MeshPlace>& places)
    : places_(places), tree_(embree::new_tree(device.get())) {
  for (std::size_t i = 0; i < places.size(); ++i) {
    Eigen::Matrix<float, 3, 4, Eigen::RowMajor> matrix;
    matrix << places[i].rotation, places[i].origin;
    RTCGeometry instance = rtcNewGeometry(device.get(), RTC_GEOMETRY_TYPE_INSTANCE);
    rtcSetGeometryInstancedScene(instance, places[i].tree->scene());
    rtcSetGeometryTransform(instance, 0, RTC_FORMAT_FLOAT3X4_ROW_MAJOR, matrix.data());
    rtcSetGeometryMask(instance, kSeen | kShadowing);
    rtcCommitGeometry(instance);
    rtcAttachGeometryByID(tree_.get(), instance, static_cast<unsigned>(i));
    rtcReleaseGeometry(instance);
  }
  embree::commit(device.get(), tree_.get());
}

void CropRays::nearest(const Eigen::Vector3f* origins, bool own_origins,
                       const Eigen::Vector3f* directions, std::size_t count, Hit* hits) const {
  RTCIntersectContext context = coherent_context();
  for (std::size_t first = 0; first < count; first += kPacket) {
    RTCRayHit8 packet;
    alignas(32) int valid[kPacket];
    for (int i = 0; i < kPacket; ++i) {
      const bool there = first + i < count;
      valid[i] = there ? -1 : 0;
      const std::size_t at = there ? first + i : first;
      set_ray(&packet.ray, i, origins[own_origins ? at : 0], directions[at], kSeen);
      packet.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
      packet.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
    }
    rtcIntersect8(valid, tree_.get(), &context, &packet);
    for (int i = 0; i < kPacket && first + i < count; ++i) {
      Hit& hit = hits[first + i];
      hit = {};
      if (packet.hit.geomID[i] == RTC_INVALID_GEOMETRY_ID) continue;
      hit.distance = packet.ray.tfar[i];
      hit.place = static_cast<int>(packet.hit.instID[0][i]);
      hit.triangle = static_cast<int>(packet.hit.primID[i]);
    }
  }
}

void CropRays::shaded(const Eigen::Vector3f* origins, const Eigen::Vector3f* directions,
                      std::size_t count, std::uint8_t* out) const {
  RTCIntersectContext context = coherent_context();
  for (std::size_t first = 0; first < count; first += kPacket) {
    RTCRay8 packet;
    alignas(32) int valid[kPacket];
    for (int i = 0; i < kPacket; ++i) {
      const bool there = first + i < count;
      valid[i] = there ? -1 : 0;
      const std::size_t at = there ? first + i : first;
      set_ray(&packet, i, origins[at], directions[at], kShadowing);
    }
    rtcOccluded8(valid, tree_.get(), &context, &packet);
    for (int i = 0; i < kPacket && first + i < count; ++i) {
      out[first + i] = packet.tfar[i] < 0.0f ? 1 : 0;
    }
  }
}

bool CropRays::blocked(int place, const Eigen::Vector3f& origin, const Eigen::Vector3f& direction,
                       float farthest) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  Eigen::Vector3f o = origin, d = direction;
  RTCScene tree = tree_.get();
  if (place >= 0) {
    const MeshPlace& p = places_[place];
    o = p.rotation.transpose() * (origin - p.origin);
    d = p.rotation.transpose() * direction;
    tree = p.tree->scene();
  }
  RTCRay ray;
  ray.org_x = o.x();
  ray.org_y = o.y();
  ray.org_z = o.z();
  ray.dir_x = d.x();
  ray.dir_y = d.y();
  ray.dir_z = d.z();
  ray.tnear = kNearest;
  ray.tfar = farthest;
  ray.time = 0.0f;
  ray.mask = ~0u;
  ray.id = 0;
  ray.flags = 0;
  rtcOccluded1(tree, &context, &ray);
  return ray.tfar < 0.0f;
}

}  // namespace camber
