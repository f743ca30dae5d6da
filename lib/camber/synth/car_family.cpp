#include "camber/synth/car_family.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace camber {

namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr int kSideRows = 5;        // of the side panel, hem to belt line
constexpr int kWindowRows = 5;      // of the greenhouse, belt line to roof
constexpr int kArchPoints = 4;      // arc pieces between two neighbouring keypoints of an arch
constexpr int kSillPieces = 12;     // between the wheel arches
constexpr int kLateralCells = 12;   // across the car
constexpr int kWheelSegments = 32;  // a multiple of 4: the lowest vertex is on the ground
constexpr std::uint64_t kNumbersPerCar = 64;

/// Spread of the overall sizes in a class: standard deviations, m, and correlations.
struct SizeSpread {
  double length, width, height;
  double length_width, length_height, width_height;
};

SizeSpread size_spread(CarClass car_class) {
  switch (car_class) {
    case CarClass::kHatchback:
      return {0.22, 0.055, 0.035, 0.70, -0.10, -0.05};  // superminis (3.9) to compacts (4.35)
    case CarClass::kSaloon:
      return {0.19, 0.045, 0.025, 0.65, 0.05, 0.05};  // 4.4 (compact) to 4.95 (executive)
    case CarClass::kEstate:
      return {0.18, 0.045, 0.030, 0.65, 0.05, 0.05};
    case CarClass::kSuv:
      return {0.22, 0.050, 0.065, 0.85, 0.45, 0.45};  // 4.1 (small) to 4.85
    case CarClass::kVan:
      return {0.33, 0.060, 0.110, 0.80, 0.65, 0.60};  // 4.3 (leisure van) to 5.3 (long transporter)
  }
  throw std::invalid_argument("car class: unknown value");
}

/// Standard deviations of the proportions other than the overall sizes, m or shares.
CarProportions proportion_spread(CarClass car_class) {
  CarProportions s;
  const bool van = car_class == CarClass::kVan;
  s.wheelbase = 0.060;
  s.front_overhang = 0.055;
  s.wheel_radius = 0.014;
  s.clearance = 0.015;
  s.arch_gap = 0.020;
  s.arch_lift = 0.020;
  s.bumper_depth = 0.045;
  s.bumper_height = 0.055;
  s.headlight_x = 0.045;
  s.headlight_y = 0.055;
  s.cowl_x = 0.090;
  s.cowl_y = 0.040;
  s.roof_front_x = 0.110;
  s.roof_rear_x = van ? 0.07 : 0.17;
  s.roof_crown = 0.025;
  s.roof_drop = 0.025;
  s.rear_window_x = van ? 0.03 : 0.09;
  s.rear_window_y = 0.050;
  s.tail_x = 0.030;
  s.tail_y = 0.090;
  s.roof_width = 0.035;
  s.cowl_width = 0.030;
  s.rear_window_width = 0.035;
  s.tail_width = 0.035;
  s.headlight_width = 0.035;
  s.bumper_width = 0.035;
  s.arch_width = 0.018;
  // An arch has no corners: where its points are put varies from car to car.
  s.arch_end_outer = 0.14;
  s.arch_end_inner = 0.14;
  s.arch_top_outer = 0.14;
  s.arch_top_inner = 0.14;
  return s;
}

constexpr double CarProportions::*kFreeProportions[] = {
    &CarProportions::front_overhang, &CarProportions::wheel_radius,
    &CarProportions::clearance,      &CarProportions::arch_gap,
    &CarProportions::arch_lift,      &CarProportions::bumper_depth,
    &CarProportions::bumper_height,  &CarProportions::headlight_x,
    &CarProportions::headlight_y,    &CarProportions::cowl_x,
    &CarProportions::cowl_y,         &CarProportions::roof_front_x,
    &CarProportions::roof_rear_x,    &CarProportions::roof_crown,
    &CarProportions::roof_drop,      &CarProportions::rear_window_x,
    &CarProportions::rear_window_y,  &CarProportions::tail_x,
    &CarProportions::tail_y,         &CarProportions::roof_width,
    &CarProportions::cowl_width,     &CarProportions::rear_window_width,
    &CarProportions::tail_width,     &CarProportions::headlight_width,
    &CarProportions::bumper_width,   &CarProportions::arch_width,
    &CarProportions::arch_end_outer, &CarProportions::arch_end_inner,
    &CarProportions::arch_top_outer, &CarProportions::arch_top_inner,
};

/// Builds the mesh of the left half as indexed vertices and mirrors it.
///
/// The body is one closed surface: a left side panel, its mirror image, and strips across between
/// the outlines of the two. The outline runs along the bottom to the front, up the nose, back over
/// the top and down the tail.
class CarBuilder {
 public:
  CarBuilder(CarClass car_class, const CarProportions& proportions)
      : p_(proportions), half_width_(0.5 * proportions.width) {
    model_.car_class = car_class;
    model_.dimensions = {p_.length, p_.width, p_.height};
    model_.wheel_radius = p_.wheel_radius;
  }

  CarModel build() {
    place_keypoints();
    build_side();
    build_across();
    for (int k : {0, 1}) {
      add_wheel(model_.keypoints[k], -1.0);
      add_wheel(model_.keypoints[k + 18], 1.0);
      add_axle_box(model_.keypoints[k]);
    }
    return std::move(model_);
  }

 private:
  /// A place of the outline with how far the surface bulges out at the car's middle.
  struct OutlinePoint {
    int vertex;                                  // left side
    double forward, upwards;                     // bulge in the middle plane, m
    CarMaterial (*material)(double w, int row);  // of the strip to the next point, w in [0, 1]
    int row;
  };

  void place_keypoints() {
    const double front_axle = 0.5 * p_.length - p_.front_overhang;
    const double rear_axle = front_axle - p_.wheelbase;
    const double arch = p_.wheel_radius + p_.arch_gap;
    const double front_corner = 0.5 * p_.length - p_.bumper_depth;
    const double rear_corner = -0.5 * p_.length + p_.bumper_depth;
    const double roof = p_.height - p_.roof_crown;
    auto set = [&](int i, double x, double y, double width_share) {
      model_.keypoints[i] = {x, y, -width_share * half_width_};
      model_.keypoints[i + 18] = {x, y, width_share * half_width_};
    };
    auto set_arch = [&](int i, double axle, double angle, double width_share) {
      set(i, axle + arch * std::cos(angle), p_.wheel_radius + p_.arch_lift + arch * std::sin(angle),
          width_share);
    };
    set(0, rear_axle, p_.wheel_radius, p_.arch_width - 0.012);
    set(1, front_axle, p_.wheel_radius, p_.arch_width - 0.012);
    set_arch(2, front_axle, p_.arch_end_outer, p_.arch_width - 0.02);
    set_arch(3, front_axle, p_.arch_top_outer, p_.arch_width);
    set_arch(4, front_axle, kPi - p_.arch_top_inner, p_.arch_width);
    set_arch(5, front_axle, kPi - p_.arch_end_inner, p_.arch_width - 0.01);
    set_arch(6, rear_axle, p_.arch_end_inner, p_.arch_width - 0.01);
    set_arch(7, rear_axle, p_.arch_top_inner, p_.arch_width);
    set_arch(8, rear_axle, kPi - p_.arch_top_outer, p_.arch_width);
    set_arch(9, rear_axle, kPi - p_.arch_end_outer, p_.arch_width - 0.02);
    set(10, rear_corner, p_.bumper_height + 0.04, p_.bumper_width);
    set(11, rear_corner + p_.tail_x, p_.tail_y, p_.tail_width);
    set(12, rear_corner + p_.rear_window_x, p_.rear_window_y, p_.rear_window_width);
    set(13, rear_axle + p_.roof_rear_x, roof - p_.roof_drop, p_.roof_width - 0.01);
    set(14, front_axle + p_.roof_front_x, roof - 0.01, p_.roof_width);
    set(15, front_axle + p_.cowl_x, p_.cowl_y, p_.cowl_width);
    set(16, front_corner + p_.headlight_x, p_.headlight_y, p_.headlight_width);
    set(17, front_corner, p_.bumper_height, p_.bumper_width);
  }

  int add_vertex(const Eigen::Vector3d& v) {
    model_.mesh.vertices.push_back(v);
    return static_cast<int>(model_.mesh.vertices.size()) - 1;
  }

  void add_triangle(int a, int b, int c, CarMaterial material) {
    model_.mesh.triangles.emplace_back(a, b, c);
    model_.mesh.materials.push_back(static_cast<int>(material));
  }

  /// A quad of the left side and its mirror image; a, b, c, d counter-clockwise from the left.
  void add_side_quad(int a, int b, int c, int d, CarMaterial material) {
    side_quads_.push_back({a, b, c, d});
    side_materials_.push_back(material);
  }

  struct Station {
    Eigen::Vector3d hem = Eigen::Vector3d::Zero(), top = Eigen::Vector3d::Zero();
    double share = 0.0;       // along the car, 0 at the rear corner, 1 at the front one
    bool arch_after = false;  // the hem to the next station is a wheel arch
  };

  std::vector<Station> make_stations() const {
    const auto& k = model_.keypoints;
    std::vector<Eigen::Vector3d> hem{k[10]};
    std::vector<bool> arch_after{false};
    auto add_arch = [&](int first, const Eigen::Vector3d& axle, int last) {
      // Keypoints first, first - 1, ... last from rear to front, with arcs between them.
      for (int i = first; i > last; --i) {
        const Eigen::Vector3d a = k[i] - axle, b = k[i - 1] - axle;
        double from = std::atan2(a.y(), a.x()), to = std::atan2(b.y(), b.x());
        if (from < -0.5 * kPi) from += 2.0 * kPi;
        if (to < -0.5 * kPi) to += 2.0 * kPi;
        const double ra = a.head<2>().norm(), rb = b.head<2>().norm();
        for (int j = 0; j < kArchPoints; ++j) {
          const double t = static_cast<double>(j) / kArchPoints;
          if (j == 0) {
            hem.push_back(k[i]);
          } else {
            const double angle = from + t * (to - from), r = ra + t * (rb - ra);
            hem.emplace_back(axle.x() + r * std::cos(angle), axle.y() + r * std::sin(angle),
                             k[i].z() + t * (k[i - 1].z() - k[i].z()));
          }
          arch_after.push_back(true);
        }
      }
      hem.push_back(k[last]);
      arch_after.push_back(false);
    };
    add_arch(9, k[0], 6);
    for (int j = 1; j < kSillPieces; ++j) {
      hem.push_back(k[6] + static_cast<double>(j) / kSillPieces * (k[5] - k[6]));
      arch_after.push_back(false);
    }
    add_arch(5, k[1], 2);
    hem.push_back(k[17]);
    arch_after.push_back(false);

    std::vector<Station> stations;
    const double hem_start = k[10].x(), hem_length = k[17].x() - k[10].x();
    const double top_start = k[11].x(), top_length = k[16].x() - k[11].x();
    for (std::size_t i = 0; i < hem.size(); ++i) {
      stations.push_back(
          {hem[i], Eigen::Vector3d::Zero(), (hem[i].x() - hem_start) / hem_length, arch_after[i]});
    }
    for (int corner : {12, 15}) {
      const double share = (k[corner].x() - top_start) / top_length;
      std::size_t next = 1;
      while (next + 1 < stations.size() && stations[next].share <= share) ++next;
      Station& before = stations[next - 1];
      Station& after = stations[next];
      const double span = after.share - before.share;
      const double t = span > 0.0 ? (share - before.share) / span : 0.5;
      if (t < 0.2 && next > 1) {
        before.share = share;
      } else if (t > 0.8 && next + 1 < stations.size()) {
        after.share = share;
      } else {
        const Station middle{before.hem + t * (after.hem - before.hem), Eigen::Vector3d::Zero(),
                             share, before.arch_after};
        stations.insert(stations.begin() + static_cast<std::ptrdiff_t>(next), middle);
      }
    }
    const int line[4] = {11, 12, 15, 16};
    for (Station& s : stations) {
      const double x = top_start + s.share * top_length;
      int i = 0;
      while (i < 2 && x > k[line[i + 1]].x() + 1e-12) ++i;
      const Eigen::Vector3d &a = k[line[i]], &b = k[line[i + 1]];
      const double t = std::clamp((x - a.x()) / (b.x() - a.x()), 0.0, 1.0);
      s.top = a + t * (b - a);
    }
    return stations;
  }

  void build_side() {
    const auto& k = model_.keypoints;
    const std::vector<Station> stations = make_stations();
    const int count = static_cast<int>(stations.size());
    auto nearest_top = [&](int corner) {
      int best = 0;
      for (int i = 1; i < count; ++i) {
        if ((stations[i].top - k[corner]).norm() < (stations[best].top - k[corner]).norm())
          best = i;
      }
      return best;
    };
    const int rear = nearest_top(12), front = nearest_top(15);

    // Side panel, bulging as far as the overall width allows.
    auto bulge_shape = [&](int i, double t) {
      const double s = std::clamp(stations[i].share, 0.0, 1.0);
      return std::pow(4.0 * t * (1.0 - t), 0.75) * std::sqrt(std::sin(kPi * s));
    };
    auto straight = [&](int i, int row) {
      const double t = static_cast<double>(row) / kSideRows;
      return Eigen::Vector3d(stations[i].hem + t * (stations[i].top - stations[i].hem));
    };
    double bulge = 1e9;
    for (int i = 0; i < count; ++i) {
      for (int row = 1; row < kSideRows; ++row) {
        const double shape = bulge_shape(i, static_cast<double>(row) / kSideRows);
        if (shape < 0.02) continue;
        bulge = std::min(bulge, (half_width_ + straight(i, row).z()) / shape);
      }
    }
    std::vector<std::vector<int>> panel(count, std::vector<int>(kSideRows + 1));
    for (int i = 0; i < count; ++i) {
      for (int row = 0; row <= kSideRows; ++row) {
        Eigen::Vector3d v = straight(i, row);
        v.z() -= bulge * bulge_shape(i, static_cast<double>(row) / kSideRows);
        panel[i][row] = add_vertex(v);
      }
    }
    for (int i = 0; i + 1 < count; ++i) {
      for (int row = 0; row < kSideRows; ++row) {
        add_side_quad(panel[i][row], panel[i][row + 1], panel[i + 1][row + 1], panel[i + 1][row],
                      CarMaterial::kPaint);
      }
    }

    // Skirts below the sills and bumpers.
    std::vector<int> skirt(count, -1);
    auto skirt_vertex = [&](int i) {
      if (skirt[i] < 0) {
        Eigen::Vector3d v = stations[i].hem;
        v.y() = std::min(p_.clearance, v.y() - 0.02);
        v.z() += 0.02;
        skirt[i] = add_vertex(v);
      }
      return skirt[i];
    };
    for (int i = 0; i + 1 < count; ++i) {
      if (stations[i].arch_after) continue;
      const int a = skirt_vertex(i), b = skirt_vertex(i + 1);
      add_side_quad(a, panel[i][0], panel[i + 1][0], b, CarMaterial::kTrim);
    }

    // Greenhouse.
    const int columns = front - rear;
    std::vector<std::vector<int>> window(columns + 1, std::vector<int>(kWindowRows + 1));
    const double belt_length = stations[front].top.x() - stations[rear].top.x();
    std::vector<double> along(columns + 1);
    for (int c = 0; c <= columns; ++c) {
      along[c] = (stations[rear + c].top.x() - stations[rear].top.x()) / belt_length;
      const Eigen::Vector3d roof =
          k[13] + along[c] * (k[14] - k[13]) +
          Eigen::Vector3d(0.0, 0.008 * 4.0 * along[c] * (1.0 - along[c]), 0.0);
      window[c][0] = panel[rear + c][kSideRows];
      for (int row = 1; row <= kWindowRows; ++row) {
        const double t = static_cast<double>(row) / kWindowRows;
        const Eigen::Vector3d belt = stations[rear + c].top;
        window[c][row] = add_vertex(belt + t * (roof - belt));
      }
    }
    const bool panel_van = model_.car_class == CarClass::kVan;
    for (int c = 0; c < columns; ++c) {
      const double middle = 0.5 * (along[c] + along[c + 1]);
      const bool pillar = middle < 0.07 || middle > 0.95 || std::abs(middle - 0.50) < 0.035 ||
                          (panel_van && middle < 0.18);
      for (int row = 0; row < kWindowRows; ++row) {
        const bool glass = !pillar && row < kWindowRows - 1;
        add_side_quad(window[c][row], window[c][row + 1], window[c + 1][row + 1],
                      window[c + 1][row], glass ? CarMaterial::kGlass : CarMaterial::kPaint);
      }
    }

    // Outline: bottom to the front, nose, top to the rear, tail.
    auto dark = [](double, int) { return CarMaterial::kTrim; };
    auto paint = [](double, int) { return CarMaterial::kPaint; };
    auto glass = [](double w, int row) {
      return w < 0.86 && row > 0 ? CarMaterial::kGlass : CarMaterial::kPaint;
    };
    auto nose = [](double w, int row) {  // rows from the bumper's bottom up
      if (row == kSideRows - 1) return w > 0.55 ? CarMaterial::kLight : CarMaterial::kTrim;
      if (row == 1 && w < 0.34) return CarMaterial::kPlate;
      if (row <= 1 && w < 0.75) return CarMaterial::kTrim;
      return CarMaterial::kPaint;
    };
    auto tail = [](double w, int row) {  // rows from the tail light down
      if (row <= 1) return w > 0.65 ? CarMaterial::kLight : CarMaterial::kPaint;
      if (row == 2 && w < 0.34) return CarMaterial::kPlate;
      return row >= 4 ? CarMaterial::kTrim : CarMaterial::kPaint;
    };

    outline_.push_back({skirt_vertex(0), 0, 0, dark, 0});
    bool on_skirt = true;
    for (int i = 0; i + 1 < count; ++i) {
      if (stations[i].arch_after) {
        if (on_skirt) outline_.push_back({panel[i][0], 0, 0, dark, 0});
        outline_.push_back({panel[i + 1][0], 0, 0, dark, 0});
        on_skirt = false;
      } else {
        if (!on_skirt) outline_.push_back({skirt_vertex(i), 0, 0, dark, 0});
        outline_.push_back({skirt_vertex(i + 1), 0, 0, dark, 0});
        on_skirt = true;
      }
    }

    // Nose: the foremost point of the middle plane is at bumper height.
    auto end_shape = [&](double y, double top) {
      const double t = std::clamp((y - 0.48) / (y > 0.48 ? top - 0.48 + 1e-9 : -0.48), 0.0, 1.0);
      return 1.0 - 0.35 * t * t;
    };
    auto position = [&](int v) { return model_.mesh.vertices[v]; };
    std::vector<int> column;
    for (int row = 0; row <= kSideRows; ++row) column.push_back(panel[count - 1][row]);
    column.insert(column.begin(), outline_.back().vertex);
    outline_.pop_back();
    double front_bulge = 1e9;
    for (int v : column) {
      front_bulge = std::min(
          front_bulge, (0.5 * p_.length - position(v).x()) / end_shape(position(v).y(), k[16].y()));
    }
    for (std::size_t j = 0; j < column.size(); ++j) {
      const int row = static_cast<int>(j) - 1;
      const Eigen::Vector3d v = position(column[j]);
      outline_.push_back({column[j], front_bulge * end_shape(v.y(), k[16].y()),
                          j + 1 == column.size() ? 0.015 : 0.0,
                          j == 0 ? +dark : (j + 1 == column.size() ? +paint : +nose), row});
    }
    // Bonnet, windscreen, roof, rear window, boot.
    auto blend = [](double a, double b, double t) { return a + t * (b - a); };
    const double nose_bulge = outline_.back().forward;
    const double cowl_forward = 0.10, cowl_up = 0.03;
    for (int i = count - 2; i >= front; --i) {
      const double t = (k[16].x() - stations[i].top.x()) / (k[16].x() - k[15].x());
      outline_.push_back({panel[i][kSideRows], blend(nose_bulge, cowl_forward, t),
                          blend(0.015, cowl_up, std::sqrt(t)), i == front ? +glass : +paint, 0});
    }
    double crown = 1e9;
    for (int c = 0; c <= columns; ++c) {
      crown = std::min(crown, p_.height - position(window[c][kWindowRows]).y());
    }
    for (int row = 1; row <= kWindowRows; ++row) {
      const double t = static_cast<double>(row) / kWindowRows;
      const bool last = row == kWindowRows;
      outline_.push_back({window[columns][row], blend(cowl_forward, 0.05, t),
                          blend(cowl_up, crown, t), last ? +paint : +glass, row});
    }
    for (int c = columns - 1; c >= 0; --c) {
      const double t = static_cast<double>(columns - c) / columns;
      outline_.push_back(
          {window[c][kWindowRows], blend(0.05, -0.04, t), crown, c == 0 ? +glass : +paint, 1});
    }
    outline_.back().row = 0;
    const double rear_back = -0.06, rear_up = 0.02;
    for (int row = kWindowRows - 1; row >= 0; --row) {
      const double t = 1.0 - static_cast<double>(row) / kWindowRows;
      outline_.push_back({window[0][row], blend(-0.04, rear_back, t), blend(crown, rear_up, t),
                          row == 0 ? +paint : +glass, row});
    }
    // Tail.
    std::vector<int> rear_column;
    for (int row = kSideRows; row >= 0; --row) rear_column.push_back(panel[0][row]);
    double rear_bulge = 1e9;
    for (int v : rear_column) {
      rear_bulge = std::min(
          rear_bulge, (0.5 * p_.length + position(v).x()) / end_shape(position(v).y(), k[11].y()));
    }
    const double tail_bulge = -rear_bulge * end_shape(k[11].y(), k[11].y());
    for (int i = rear - 1; i >= 1; --i) {
      const double span = k[12].x() - k[11].x();
      const double t = span > 0.0 ? (k[12].x() - stations[i].top.x()) / span : 1.0;
      outline_.push_back({panel[i][kSideRows], blend(rear_back, tail_bulge, t),
                          blend(rear_up, 0.01, t), paint, 0});
    }
    for (std::size_t j = 0; j < rear_column.size(); ++j) {
      const double y = position(rear_column[j]).y();
      outline_.push_back({rear_column[j], -rear_bulge * end_shape(y, k[11].y()),
                          j == 0 ? 0.01 : 0.0, tail, static_cast<int>(j)});
    }
    outline_.front().forward =
        -rear_bulge * end_shape(position(outline_.front().vertex).y(), k[11].y()) * 0.9;
  }

  void build_across() {
    auto& vertices = model_.mesh.vertices;
    const int left_count = static_cast<int>(vertices.size());
    for (int i = 0; i < left_count; ++i) {
      const Eigen::Vector3d v = vertices[i];
      vertices.emplace_back(v.x(), v.y(), -v.z());
    }
    for (std::size_t i = 0; i < side_quads_.size(); ++i) {
      const auto& q = side_quads_[i];
      add_triangle(q[0], q[1], q[2], side_materials_[i]);
      add_triangle(q[0], q[2], q[3], side_materials_[i]);
      add_triangle(q[0] + left_count, q[2] + left_count, q[1] + left_count, side_materials_[i]);
      add_triangle(q[0] + left_count, q[3] + left_count, q[2] + left_count, side_materials_[i]);
    }
    const std::size_t n = outline_.size();
    std::vector<std::array<int, kLateralCells + 1>> rows(n);
    for (std::size_t i = 0; i < n; ++i) {
      const OutlinePoint& o = outline_[i];
      const Eigen::Vector3d left = vertices[o.vertex];
      rows[i][0] = o.vertex;
      rows[i][kLateralCells] = o.vertex + left_count;
      for (int c = 1; c < kLateralCells; ++c) {
        const double w = -1.0 + 2.0 * c / kLateralCells;
        const double bulge = 1.0 - w * w;
        rows[i][c] =
            add_vertex({left.x() + o.forward * bulge, left.y() + o.upwards * bulge, -w * left.z()});
      }
    }
    for (std::size_t i = 0; i < n; ++i) {
      const std::size_t j = (i + 1) % n;
      for (int c = 0; c < kLateralCells; ++c) {
        const double w = std::abs(-1.0 + (2.0 * c + 1.0) / kLateralCells);
        const CarMaterial material = outline_[i].material(w, outline_[i].row);
        add_triangle(rows[i][c], rows[j][c], rows[j][c + 1], material);
        add_triangle(rows[i][c], rows[j][c + 1], rows[i][c + 1], material);
      }
    }
  }

  /// A closed disc: tyre, with a rim of 0.66 of the radius. `side` -1: left, its outer face to -z.
  void add_wheel(const Eigen::Vector3d& center, double side) {
    const double r = p_.wheel_radius, thickness = 0.21;
    const double radii[5] = {0.0, 0.66 * r, 0.95 * r, r, r};
    const double depths[5] = {0.0, 0.0, 0.0, 0.025, thickness};
    const CarMaterial materials[4] = {CarMaterial::kRim, CarMaterial::kTyre, CarMaterial::kTyre,
                                      CarMaterial::kTyre};
    std::vector<std::vector<int>> rings;
    auto ring = [&](double radius, double depth) {
      std::vector<int> out;
      for (int i = 0; i < kWheelSegments; ++i) {
        const double a = 2.0 * kPi * i / kWheelSegments;
        double dy = radius * std::sin(a);
        if (i == 3 * kWheelSegments / 4) dy = -radius;
        out.push_back(
            add_vertex(center + Eigen::Vector3d(radius * std::cos(a), dy, -side * depth)));
      }
      return out;
    };
    const int hub = add_vertex(center);
    for (int i = 1; i < 5; ++i) rings.push_back(ring(radii[i], depths[i]));
    const int inner = add_vertex(center + Eigen::Vector3d(0, 0, -side * thickness));
    auto triangle = [&](int a, int b, int c, CarMaterial m) {
      if (side > 0) {
        add_triangle(a, b, c, m);
      } else {
        add_triangle(a, c, b, m);
      }
    };
    for (int i = 0; i < kWheelSegments; ++i) {
      const int j = (i + 1) % kWheelSegments;
      triangle(hub, rings[0][i], rings[0][j], materials[0]);
      for (int q = 0; q < 3; ++q) {
        triangle(rings[q][i], rings[q + 1][i], rings[q + 1][j], materials[q + 1]);
        triangle(rings[q][i], rings[q + 1][j], rings[q][j], materials[q + 1]);
      }
      triangle(inner, rings[3][j], rings[3][i], CarMaterial::kTyre);
    }
  }

  /// A dark closed box between the wheels of an axle, so that nobody sees through the arches.
  void add_axle_box(const Eigen::Vector3d& wheel) {
    const double arch = p_.wheel_radius + p_.arch_gap + 0.01;
    const double xs[2] = {wheel.x() - arch, wheel.x() + arch};
    const double ys[2] = {p_.clearance + 0.01, p_.wheel_radius + arch};
    const double zs[2] = {wheel.z() + 0.2, -wheel.z() - 0.2};
    const int first = static_cast<int>(model_.mesh.vertices.size());
    for (int i = 0; i < 8; ++i) add_vertex({xs[i & 1], ys[(i >> 1) & 1], zs[i >> 2]});
    constexpr int kFaces[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4},
                                  {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
    for (const auto& f : kFaces) {
      add_triangle(first + f[0], first + f[1], first + f[2], CarMaterial::kTrim);
      add_triangle(first + f[0], first + f[2], first + f[3], CarMaterial::kTrim);
    }
  }

  CarProportions p_;
  double half_width_;
  CarModel model_;
  std::vector<std::array<int, 4>> side_quads_;
  std::vector<CarMaterial> side_materials_;
  std::vector<OutlinePoint> outline_;
};

}  // namespace

std::string_view to_string(CarClass car_class) {
  switch (car_class) {
    case CarClass::kHatchback:
      return "hatchback";
    case CarClass::kSaloon:
      return "saloon";
    case CarClass::kEstate:
      return "estate";
    case CarClass::kSuv:
      return "suv";
    case CarClass::kVan:
      return "van";
  }
  return "unknown";
}

CarProportions mean_proportions(CarClass car_class) {
  CarProportions p;
  // What the classes share; overridden below.
  p.wheel_radius = 0.315;
  p.clearance = 0.17;
  p.arch_gap = 0.060;
  p.arch_lift = 0.020;
  p.bumper_depth = 0.13;
  p.bumper_height = 0.30;
  p.headlight_x = -0.09;
  p.roof_crown = 0.075;
  p.roof_drop = 0.02;
  p.cowl_width = 0.86;
  p.rear_window_width = 0.80;
  p.tail_width = 0.82;
  p.headlight_width = 0.84;
  p.bumper_width = 0.88;
  p.arch_width = 0.955;
  p.arch_end_outer = -0.13;
  p.arch_end_inner = -0.16;
  p.arch_top_outer = 0.80;
  p.arch_top_inner = 0.80;
  switch (car_class) {
    case CarClass::kHatchback:  // superminis (3.75 x 1.65 to 4.0 x 1.70), compacts (4.15 to 4.3
                                // x 1.78)
      p.length = 4.03, p.width = 1.72, p.height = 1.47;
      p.wheelbase = 2.52, p.front_overhang = 0.82;
      p.wheel_radius = 0.308;
      p.headlight_y = 0.72;
      p.cowl_x = -0.42, p.cowl_y = 0.95;
      p.roof_front_x = -1.05, p.roof_rear_x = -0.22;
      p.rear_window_x = 0.14, p.rear_window_y = 0.99;
      p.tail_x = 0.03, p.tail_y = 0.88;
      p.roof_width = 0.68;
      break;
    case CarClass::kSaloon:  // 4.45 to 4.80 x 1.73 to 1.84 x 1.41 to 1.48
      p.length = 4.61, p.width = 1.785, p.height = 1.445;
      p.wheelbase = 2.73, p.front_overhang = 0.86;
      p.headlight_y = 0.70;
      p.cowl_x = -0.52, p.cowl_y = 0.95;
      p.roof_front_x = -1.18, p.roof_rear_x = 0.22;
      p.rear_window_x = 0.52, p.rear_window_y = 1.02;
      p.tail_x = 0.03, p.tail_y = 0.93;
      p.roof_width = 0.65;
      break;
    case CarClass::kEstate:  // 4.45 to 4.80 x 1.73 to 1.83 x 1.44 to 1.52
      p.length = 4.58, p.width = 1.77, p.height = 1.475;
      p.wheelbase = 2.67, p.front_overhang = 0.88;
      p.headlight_y = 0.71;
      p.cowl_x = -0.48, p.cowl_y = 0.95;
      p.roof_front_x = -1.12, p.roof_rear_x = -0.52;
      p.rear_window_x = 0.13, p.rear_window_y = 1.01;
      p.tail_x = 0.03, p.tail_y = 0.92;
      p.roof_width = 0.66;
      break;
    case CarClass::kSuv:  // 4.20 to 4.70 x 1.78 to 1.90 x 1.58 to 1.74
      p.length = 4.42, p.width = 1.82, p.height = 1.655;
      p.wheelbase = 2.64, p.front_overhang = 0.88;
      p.wheel_radius = 0.345;
      p.clearance = 0.22;
      p.bumper_height = 0.38;
      p.headlight_y = 0.86;
      p.cowl_x = -0.44, p.cowl_y = 1.10;
      p.roof_front_x = -1.02, p.roof_rear_x = -0.40;
      p.rear_window_x = 0.13, p.rear_window_y = 1.15;
      p.tail_x = 0.03, p.tail_y = 1.00;
      p.roof_width = 0.67;
      break;
    case CarClass::kVan:  // leisure vans (4.40 x 1.80 x 1.82) and transporters (4.90 x 1.90 x 1.97)
      p.length = 4.75, p.width = 1.87, p.height = 1.93;
      p.wheelbase = 2.92, p.front_overhang = 0.92;
      p.wheel_radius = 0.330;
      p.bumper_height = 0.34;
      p.headlight_x = -0.12;
      p.headlight_y = 0.86;
      p.cowl_x = -0.18, p.cowl_y = 1.12;
      p.roof_front_x = -0.80, p.roof_rear_x = -0.66;
      p.rear_window_x = 0.03, p.rear_window_y = 1.14;
      p.tail_x = 0.01, p.tail_y = 1.05;
      p.roof_width = 0.80;
      p.rear_window_width = 0.86;
      p.tail_width = 0.88;
      p.cowl_width = 0.88;
      break;
  }
  return p;
}

CarModel make_car(CarClass car_class, const CarProportions& proportions) {
  return CarBuilder(car_class, proportions).build();
}

CarModel make_car(CarClass car_class) { return make_car(car_class, mean_proportions(car_class)); }

CarModel sample_car(CarClass car_class, const CounterRandom& random, std::uint64_t index) {
  std::uint64_t counter = index * kNumbersPerCar;
  auto draw = [&] { return std::clamp(random.normal(counter++), -2.5, 2.5); };
  const CarProportions mean = mean_proportions(car_class);
  const CarProportions spread = proportion_spread(car_class);
  CarProportions p = mean;

  const SizeSpread s = size_spread(car_class);
  Eigen::Matrix3d correlation;
  correlation << 1.0, s.length_width, s.length_height, s.length_width, 1.0, s.width_height,
      s.length_height, s.width_height, 1.0;
  const Eigen::Matrix3d root = correlation.llt().matrixL();
  Eigen::Vector3d z;
  for (int i = 0; i < 3; ++i) z[i] = draw();
  const Eigen::Vector3d size = root * z;
  p.length += s.length * size[0];
  p.width += s.width * size[1];
  p.height += s.height * size[2];

  // Larger cars have longer wheelbases and larger wheels; heights follow the car's.
  const double longer = p.length / mean.length, taller = p.height / mean.height;
  p.wheelbase = mean.wheelbase * (1.0 + 0.85 * (longer - 1.0)) + spread.wheelbase * draw();
  p.front_overhang = mean.front_overhang * (1.0 + 0.8 * (longer - 1.0));
  p.wheel_radius = mean.wheel_radius * (1.0 + 0.35 * (longer - 1.0) + 0.35 * (taller - 1.0));
  p.cowl_x *= longer;
  p.roof_front_x *= longer;
  p.roof_rear_x *= longer;
  p.rear_window_x *= longer;
  p.cowl_y *= taller;
  p.headlight_y *= taller;
  p.rear_window_y *= taller;
  p.tail_y *= taller;
  for (double CarProportions::*field : kFreeProportions) p.*field += spread.*field * draw();

  // Keep the order of the parts whatever the draw.
  p.bumper_depth = std::max(p.bumper_depth, 0.04);
  p.arch_gap = std::max(p.arch_gap, 0.025);
  p.arch_lift = std::clamp(p.arch_lift, -0.02, 0.06);
  const double rear_overhang_min = p.wheel_radius + p.arch_gap + p.bumper_depth + 0.04;
  p.front_overhang =
      std::max(p.front_overhang, p.wheel_radius + p.arch_gap + p.bumper_depth + 0.04);
  p.wheelbase = std::min(p.wheelbase, p.length - p.front_overhang - rear_overhang_min);
  p.headlight_x = std::min(p.headlight_x, -0.01);
  p.tail_x = std::max(p.tail_x, 0.0);
  p.rear_window_x = std::max(p.rear_window_x, p.tail_x + 0.015);
  p.rear_window_y = std::max(p.rear_window_y, p.tail_y + 0.02);
  p.arch_width = std::min(p.arch_width, 0.99);
  p.roof_crown = std::max(p.roof_crown, 0.03);
  p.roof_drop = std::max(p.roof_drop, 0.0);
  p.bumper_height = std::max(p.bumper_height, p.clearance + 0.05);
  const double rear_axle_to_corner = p.length - p.wheelbase - p.front_overhang - p.bumper_depth;
  p.roof_rear_x = std::max(p.roof_rear_x, p.rear_window_x - rear_axle_to_corner + 0.02);
  p.roof_front_x = std::min(p.roof_front_x, p.cowl_x - 0.25);
  return make_car(car_class, p);
}

CarModel sample_car(const CounterRandom& random, std::uint64_t index) {
  constexpr double kShares[kNumCarClasses] = {0.45, 0.17, 0.15, 0.17, 0.06};
  // uniform() and normal() never share a number, so the class does not depend on the sizes.
  double u = random.uniform(index);
  int chosen = 0;
  while (chosen + 1 < kNumCarClasses && u >= kShares[chosen]) u -= kShares[chosen++];
  return sample_car(static_cast<CarClass>(chosen), random, index);
}

}  // namespace camber
