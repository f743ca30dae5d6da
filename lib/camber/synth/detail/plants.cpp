#include "camber/synth/detail/plants.h"

#include <Eigen/Geometry>
#include <cmath>

#include "camber/synth/detail/noise.h"
#include "camber/synth/detail/sequence.h"

namespace camber {
namespace {

constexpr double kPi = 3.14159265358979323846;

/// Leaves on the shell of an ellipsoid, each a small rhomb.
void add_crown(const Eigen::Vector3d& middle, const Eigen::Vector3d& radii, int count, double leaf,
               int object, Sequence* random, SynthMesh* mesh) {
  for (int i = 0; i < count; ++i) {
    const double z = random->uniform(-1.0, 1.0), a = random->uniform(0.0, 2 * kPi);
    const double r = std::sqrt(1.0 - z * z);
    const double shell = std::cbrt(random->uniform(0.25, 1.0));
    const Eigen::Vector3d out(r * std::cos(a), r * std::sin(a), z);
    const Eigen::Vector3d p = middle + shell * radii.cwiseProduct(out);
    Eigen::Vector3d n(random->normal(), random->normal(), random->normal());
    n = (n.normalized() + 1.2 * out).normalized();
    const Eigen::Vector3d u = n.unitOrthogonal();
    const Eigen::Vector3d w = n.cross(u);
    const double turn = random->uniform(0.0, 2 * kPi);
    const double half = leaf * random->uniform(0.6, 1.2);
    const Eigen::Vector3d x = half * (std::cos(turn) * u + std::sin(turn) * w);
    const Eigen::Vector3d y = 0.6 * half * (-std::sin(turn) * u + std::cos(turn) * w);
    // Lit as the crown as a whole; the texture coordinate keeps the depth inside it.
    const Eigen::Vector3f normal = out.cast<float>();
    const auto shade = static_cast<float>(shell);
    const auto tone = static_cast<float>(random->uniform(0.0, 1.0));
    const Eigen::Vector2f texture(shade, tone);
    mesh->triangles.push_back(
        {{p - x, p + y, p + x}, {normal, normal, normal}, {texture, texture, texture}, object});
    mesh->triangles.push_back(
        {{p - x, p + x, p - y}, {normal, normal, normal}, {texture, texture, texture}, object});
  }
}

int leaf_object(std::uint32_t seed, MeshBuilder* builder) {
  SynthObject leaves;
  leaves.kind = SurfaceKind::kLeaf;
  leaves.label = TruthLabel::kVegetation;
  const float warm = hash_unit(1, 2, seed), bright = 0.7f + 0.6f * hash_unit(3, 4, seed);
  leaves.color = bright * Eigen::Vector3f(0.060f + 0.045f * warm, 0.110f, 0.026f);
  leaves.seed = seed;
  return builder->add_object(leaves);
}

}  // namespace

void plant_tree(const Eigen::Vector3d& p, double size, bool far, std::uint32_t seed,
                MeshBuilder* builder) {
  Sequence random(seed, 0x54524545);
  SynthObject bark;
  bark.kind = SurfaceKind::kBark;
  bark.label = TruthLabel::kVegetation;
  bark.color = linear_color(92, 76, 60);
  bark.seed = seed;
  const double height = size * random.uniform(5.0, 8.0);
  const double lean_y = random.uniform(-0.2, 0.2), lean_x = random.uniform(-0.2, 0.2);
  const Eigen::Vector3d lean(lean_x, lean_y, 0.0);
  const double trunk = 0.38 * height;
  builder->post(builder->add_object(bark), p - Eigen::Vector3d(0, 0, 0.3),
                p + lean + Eigen::Vector3d(0, 0, 0.62 * height), 0.03 * height, 0.015 * height, 9);
  const int leaves = leaf_object(seed, builder);
  const int blobs = 5;
  const int share = far ? 90 : 420;
  const double leaf = far ? 0.32 : 0.15;
  for (int i = 0; i < blobs; ++i) {
    const double spread = 0.17 * height;
    const double dz = trunk + (height - trunk) * random.uniform(0.25, 0.75);
    const double dy = random.uniform(-spread, spread), dx = random.uniform(-spread, spread);
    const double r = height * random.uniform(0.15, 0.22);
    add_crown(p + lean + Eigen::Vector3d(dx, dy, dz), {r, r, 0.9 * r}, share, leaf, leaves, &random,
              &builder->mesh());
  }
}

void plant_bush(const Eigen::Vector3d& p, double size, bool far, std::uint32_t seed,
                MeshBuilder* builder) {
  Sequence random(seed, 0x42555348);
  const int leaves = leaf_object(seed, builder);
  const int blobs = 3;
  for (int i = 0; i < blobs; ++i) {
    const double r = size * random.uniform(0.4, 0.65);
    const double dy = random.uniform(-0.6, 0.6) * size, dx = random.uniform(-0.6, 0.6) * size;
    add_crown(p + Eigen::Vector3d(dx, dy, 0.7 * r), {r, r, r}, far ? 60 : 170, 0.11, leaves,
              &random, &builder->mesh());
  }
}

}  // namespace camber
