#include "camber/synth/detail/car_body.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace camber {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr int kSideRows = 5;        // of the side panel, hem to belt line
constexpr int kWindowRows = 5;      // of the greenhouse, belt line to roof
constexpr int kArchPoints = 4;      // arc pieces between two neighbouring keypoints of an arch
constexpr int kSillPieces = 12;     // between the wheel arches
constexpr int kLateralCells = 12;   // across the car
constexpr int kWheelSegments = 32;  // a multiple of 4: the lowest vertex is on the ground

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
      const double arch = p_.wheel_radius + p_.arch_gap + 0.01;
      add_axle_box(model_.keypoints[k], arch, p_.clearance + 0.01, p_.wheel_radius + arch,
                   &model_.mesh);
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

  /// The lower edge of the side panel from the rear corner to the front one, with the arcs of the
  /// wheel arches. @param arch_after  whether an arch goes on after each of its points.
  std::vector<Eigen::Vector3d> make_hem(std::vector<bool>* arch_after) const {
    const auto& k = model_.keypoints;
    std::vector<Eigen::Vector3d> hem{k[10]};
    arch_after->assign(1, false);
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
          arch_after->push_back(true);
        }
      }
      hem.push_back(k[last]);
      arch_after->push_back(false);
    };
    add_arch(9, k[0], 6);
    for (int j = 1; j < kSillPieces; ++j) {
      hem.push_back(k[6] + static_cast<double>(j) / kSillPieces * (k[5] - k[6]));
      arch_after->push_back(false);
    }
    add_arch(5, k[1], 2);
    hem.push_back(k[17]);
    arch_after->push_back(false);
    return hem;
  }

  std::vector<Station> make_stations() const {
    const auto& k = model_.keypoints;
    std::vector<bool> arch_after;
    const std::vector<Eigen::Vector3d> hem = make_hem(&arch_after);

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
    stations_ = make_stations();
    build_panel();
    build_skirts();
    build_greenhouse();
    // The outline: bottom to the front, nose, top to the rear, tail.
    outline_bottom();
    outline_nose();
    outline_top();
    outline_tail();
  }

  int num_stations() const { return static_cast<int>(stations_.size()); }
  Eigen::Vector3d position(int vertex) const { return model_.mesh.vertices[vertex]; }
  static double blend(double a, double b, double t) { return a + t * (b - a); }

  /// The station whose top is nearest to a keypoint.
  int nearest_top(int corner) const {
    const auto& k = model_.keypoints;
    int best = 0;
    for (int i = 1; i < num_stations(); ++i) {
      if ((stations_[i].top - k[corner]).norm() < (stations_[best].top - k[corner]).norm())
        best = i;
    }
    return best;
  }

  /// Side panel, bulging as far as the overall width allows.
  void build_panel() {
    const int count = num_stations();
    auto bulge_shape = [&](int i, double t) {
      const double s = std::clamp(stations_[i].share, 0.0, 1.0);
      return std::pow(4.0 * t * (1.0 - t), 0.75) * std::sqrt(std::sin(kPi * s));
    };
    auto straight = [&](int i, int row) {
      const double t = static_cast<double>(row) / kSideRows;
      return Eigen::Vector3d(stations_[i].hem + t * (stations_[i].top - stations_[i].hem));
    };
    double bulge = 1e9;
    for (int i = 0; i < count; ++i) {
      for (int row = 1; row < kSideRows; ++row) {
        const double shape = bulge_shape(i, static_cast<double>(row) / kSideRows);
        if (shape < 0.02) continue;
        bulge = std::min(bulge, (half_width_ + straight(i, row).z()) / shape);
      }
    }
    panel_.assign(count, std::vector<int>(kSideRows + 1));
    for (int i = 0; i < count; ++i) {
      for (int row = 0; row <= kSideRows; ++row) {
        Eigen::Vector3d v = straight(i, row);
        v.z() -= bulge * bulge_shape(i, static_cast<double>(row) / kSideRows);
        panel_[i][row] = add_vertex(v);
      }
    }
    for (int i = 0; i + 1 < count; ++i) {
      for (int row = 0; row < kSideRows; ++row) {
        add_side_quad(panel_[i][row], panel_[i][row + 1], panel_[i + 1][row + 1],
                      panel_[i + 1][row], CarMaterial::kPaint);
      }
    }
  }

  int skirt_vertex(int i) {
    if (skirt_[i] < 0) {
      Eigen::Vector3d v = stations_[i].hem;
      v.y() = std::min(p_.clearance, v.y() - 0.02);
      v.z() += 0.02;
      skirt_[i] = add_vertex(v);
    }
    return skirt_[i];
  }

  /// Skirts below the sills and bumpers.
  void build_skirts() {
    skirt_.assign(num_stations(), -1);
    for (int i = 0; i + 1 < num_stations(); ++i) {
      if (stations_[i].arch_after) continue;
      const int a = skirt_vertex(i), b = skirt_vertex(i + 1);
      add_side_quad(a, panel_[i][0], panel_[i + 1][0], b, CarMaterial::kTrim);
    }
  }

  void build_greenhouse() {
    const auto& k = model_.keypoints;
    rear_ = nearest_top(12);
    front_ = nearest_top(15);
    const int columns = front_ - rear_;
    window_.assign(columns + 1, std::vector<int>(kWindowRows + 1));
    const double belt_length = stations_[front_].top.x() - stations_[rear_].top.x();
    std::vector<double> along(columns + 1);
    for (int c = 0; c <= columns; ++c) {
      along[c] = (stations_[rear_ + c].top.x() - stations_[rear_].top.x()) / belt_length;
      const Eigen::Vector3d roof =
          k[13] + along[c] * (k[14] - k[13]) +
          Eigen::Vector3d(0.0, 0.008 * 4.0 * along[c] * (1.0 - along[c]), 0.0);
      window_[c][0] = panel_[rear_ + c][kSideRows];
      for (int row = 1; row <= kWindowRows; ++row) {
        const double t = static_cast<double>(row) / kWindowRows;
        const Eigen::Vector3d belt = stations_[rear_ + c].top;
        window_[c][row] = add_vertex(belt + t * (roof - belt));
      }
    }
    const bool panel_van = model_.car_class == CarClass::kVan;
    for (int c = 0; c < columns; ++c) {
      const double middle = 0.5 * (along[c] + along[c + 1]);
      const bool pillar = middle < 0.07 || middle > 0.95 || std::abs(middle - 0.50) < 0.035 ||
                          (panel_van && middle < 0.18);
      for (int row = 0; row < kWindowRows; ++row) {
        const bool glass = !pillar && row < kWindowRows - 1;
        add_side_quad(window_[c][row], window_[c][row + 1], window_[c + 1][row + 1],
                      window_[c + 1][row], glass ? CarMaterial::kGlass : CarMaterial::kPaint);
      }
    }
  }

  // Materials of the strips across, by the share of the half width and the row.
  static CarMaterial dark(double, int) { return CarMaterial::kTrim; }
  static CarMaterial paint(double, int) { return CarMaterial::kPaint; }
  static CarMaterial glass(double w, int row) {
    return w < 0.86 && row > 0 ? CarMaterial::kGlass : CarMaterial::kPaint;
  }
  static CarMaterial nose(double w, int row) {  // rows from the bumper's bottom up
    if (row == kSideRows - 1) return w > 0.55 ? CarMaterial::kLight : CarMaterial::kTrim;
    if (row == 1 && w < 0.34) return CarMaterial::kPlate;
    if (row <= 1 && w < 0.75) return CarMaterial::kTrim;
    return CarMaterial::kPaint;
  }
  static CarMaterial tail(double w, int row) {  // rows from the tail light down
    if (row <= 1) return w > 0.65 ? CarMaterial::kLight : CarMaterial::kPaint;
    if (row == 2 && w < 0.34) return CarMaterial::kPlate;
    return row >= 4 ? CarMaterial::kTrim : CarMaterial::kPaint;
  }

  void outline_bottom() {
    outline_.push_back({skirt_vertex(0), 0, 0, dark, 0});
    bool on_skirt = true;
    for (int i = 0; i + 1 < num_stations(); ++i) {
      if (stations_[i].arch_after) {
        if (on_skirt) outline_.push_back({panel_[i][0], 0, 0, dark, 0});
        outline_.push_back({panel_[i + 1][0], 0, 0, dark, 0});
        on_skirt = false;
      } else {
        if (!on_skirt) outline_.push_back({skirt_vertex(i), 0, 0, dark, 0});
        outline_.push_back({skirt_vertex(i + 1), 0, 0, dark, 0});
        on_skirt = true;
      }
    }
  }

  /// The foremost (rearmost) point of the middle plane is at bumper height.
  static double end_shape(double y, double top) {
    const double t = std::clamp((y - 0.48) / (y > 0.48 ? top - 0.48 + 1e-9 : -0.48), 0.0, 1.0);
    return 1.0 - 0.35 * t * t;
  }

  void outline_nose() {
    const auto& k = model_.keypoints;
    std::vector<int> column;
    for (int row = 0; row <= kSideRows; ++row) column.push_back(panel_[num_stations() - 1][row]);
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
                          j == 0 ? dark : (j + 1 == column.size() ? paint : nose), row});
    }
  }

  /// Bonnet, windscreen, roof and rear window.
  void outline_top() {
    const auto& k = model_.keypoints;
    const int columns = front_ - rear_;
    const double nose_bulge = outline_.back().forward;
    const double cowl_forward = 0.10, cowl_up = 0.03;
    for (int i = num_stations() - 2; i >= front_; --i) {
      const double t = (k[16].x() - stations_[i].top.x()) / (k[16].x() - k[15].x());
      outline_.push_back({panel_[i][kSideRows], blend(nose_bulge, cowl_forward, t),
                          blend(0.015, cowl_up, std::sqrt(t)), i == front_ ? glass : paint, 0});
    }
    double crown = 1e9;
    for (int c = 0; c <= columns; ++c) {
      crown = std::min(crown, p_.height - position(window_[c][kWindowRows]).y());
    }
    for (int row = 1; row <= kWindowRows; ++row) {
      const double t = static_cast<double>(row) / kWindowRows;
      const bool last = row == kWindowRows;
      outline_.push_back({window_[columns][row], blend(cowl_forward, 0.05, t),
                          blend(cowl_up, crown, t), last ? paint : glass, row});
    }
    for (int c = columns - 1; c >= 0; --c) {
      const double t = static_cast<double>(columns - c) / columns;
      outline_.push_back(
          {window_[c][kWindowRows], blend(0.05, -0.04, t), crown, c == 0 ? glass : paint, 1});
    }
    outline_.back().row = 0;
    for (int row = kWindowRows - 1; row >= 0; --row) {
      const double t = 1.0 - static_cast<double>(row) / kWindowRows;
      outline_.push_back({window_[0][row], blend(-0.04, kRearBack, t), blend(crown, kRearUp, t),
                          row == 0 ? paint : glass, row});
    }
  }

  /// Boot and tail.
  void outline_tail() {
    const auto& k = model_.keypoints;
    std::vector<int> rear_column;
    for (int row = kSideRows; row >= 0; --row) rear_column.push_back(panel_[0][row]);
    double rear_bulge = 1e9;
    for (int v : rear_column) {
      rear_bulge = std::min(
          rear_bulge, (0.5 * p_.length + position(v).x()) / end_shape(position(v).y(), k[11].y()));
    }
    const double tail_bulge = -rear_bulge * end_shape(k[11].y(), k[11].y());
    for (int i = rear_ - 1; i >= 1; --i) {
      const double span = k[12].x() - k[11].x();
      const double t = span > 0.0 ? (k[12].x() - stations_[i].top.x()) / span : 1.0;
      outline_.push_back({panel_[i][kSideRows], blend(kRearBack, tail_bulge, t),
                          blend(kRearUp, 0.01, t), paint, 0});
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

  CarProportions p_;
  double half_width_;
  CarModel model_;
  std::vector<std::array<int, 4>> side_quads_;
  std::vector<CarMaterial> side_materials_;
  std::vector<OutlinePoint> outline_;

  // Of the left side: stations from the rear to the front, vertices by station and row; the
  // greenhouse stands on the stations rear_ to front_.
  static constexpr double kRearBack = -0.06, kRearUp = 0.02;
  std::vector<Station> stations_;
  std::vector<std::vector<int>> panel_, window_;
  std::vector<int> skirt_;
  int rear_ = 0, front_ = 0;
};

}  // namespace

CarModel build_car_body(CarClass car_class, const CarProportions& proportions) {
  return CarBuilder(car_class, proportions).build();
}

void add_axle_box(const Eigen::Vector3d& wheel, double reach, double low, double high,
                  TriangleMesh* mesh) {
  const double xs[2] = {wheel.x() - reach, wheel.x() + reach};
  const double ys[2] = {low, high};
  const double zs[2] = {wheel.z() + 0.2, -wheel.z() - 0.2};
  const int first = static_cast<int>(mesh->vertices.size());
  for (int i = 0; i < 8; ++i) mesh->vertices.emplace_back(xs[i & 1], ys[(i >> 1) & 1], zs[i >> 2]);
  constexpr int kFaces[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4},
                                {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
  for (const auto& f : kFaces) {
    mesh->triangles.emplace_back(first + f[0], first + f[1], first + f[2]);
    mesh->triangles.emplace_back(first + f[0], first + f[2], first + f[3]);
    mesh->materials.insert(mesh->materials.end(), 2, static_cast<int>(CarMaterial::kTrim));
  }
}

}  // namespace camber
