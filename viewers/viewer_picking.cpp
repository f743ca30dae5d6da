// What is under the pointer, and the facts about it.

#include "camber/evaluate/metrics.h"
#include "detail/viewer_state.h"

namespace camber {
namespace {

/// Metres along the ray to a vehicle's box; negative: misses it.
double hit_box(const Ray& ray, const OrientedBox& box) {
  const SE3 inside = box.camera_from_vehicle.inverse();
  const Eigen::Vector3d start = inside * ray.start, direction = inside.rotation() * ray.direction;
  const Dimensions& d = box.dimensions;
  const double low[3] = {-0.5 * d.length, 0.0, -0.5 * d.width};
  const double high[3] = {0.5 * d.length, d.height, 0.5 * d.width};
  double enter = 0.0, leave = 1e30;
  for (int k = 0; k < 3; ++k) {
    if (std::abs(direction[k]) < 1e-12) {
      if (start[k] < low[k] || start[k] > high[k]) return -1.0;
      continue;
    }
    const double a = (low[k] - start[k]) / direction[k], b = (high[k] - start[k]) / direction[k];
    enter = std::max(enter, std::min(a, b));
    leave = std::min(leave, std::max(a, b));
  }
  return enter <= leave ? enter : -1.0;
}

/// Metres along the ray to a patch; negative: misses it.
double hit_patch(const Ray& ray, const PlacedPatch& patch) {
  const double slope = patch.normal.dot(ray.direction);
  if (std::abs(slope) < 1e-9) return -1.0;
  const double t = patch.normal.dot(patch.middle - ray.start) / slope;
  if (!(t > 0.0)) return -1.0;
  const Eigen::Vector3d x = ray.start + t * ray.direction;
  bool inside = false;  // even-odd rule, seen from above
  for (std::size_t i = 0, j = patch.boundary.size() - 1; i < patch.boundary.size(); j = i++) {
    const Eigen::Vector3d &a = patch.boundary[i], &b = patch.boundary[j];
    if ((a.y() > x.y()) != (b.y() > x.y()) &&
        x.x() < (b.x() - a.x()) * (x.y() - a.y()) / (b.y() - a.y()) + a.x()) {
      inside = !inside;
    }
  }
  return inside ? t : -1.0;
}

}  // namespace

Eigen::Matrix4d ViewerWindow::Impl::projection() const {
  vtkRenderer* scene = renderer;
  const vtkMatrix4x4* m = scene->GetActiveCamera()->GetCompositeProjectionTransformMatrix(
      static_cast<double>(view->width()) / std::max(1, view->height()), -1.0, 1.0);
  Eigen::Matrix4d out;
  for (int i = 0; i < 4; ++i) {
    for (int j = 0; j < 4; ++j) out(i, j) = m->GetElement(i, j);
  }
  return out;
}

Ray ViewerWindow::Impl::ray_at(const QPoint& at) const {
  const Eigen::Matrix4d back = projection().inverse();
  const double x = 2.0 * (at.x() + 0.5) / view->width() - 1.0;
  const double y = 1.0 - 2.0 * (at.y() + 0.5) / view->height();
  const Eigen::Vector3d near = (back * Eigen::Vector4d(x, y, -1.0, 1.0)).hnormalized();
  const Eigen::Vector3d far = (back * Eigen::Vector4d(x, y, 1.0, 1.0)).hnormalized();
  return {near, (far - near).normalized()};
}

int ViewerWindow::Impl::point_at(const QPoint& at, const Ray& ray) const {
  const Eigen::Matrix4f m = projection().cast<float>();
  const float half_w = 0.5f * static_cast<float>(view->width());
  const float half_h = 0.5f * static_cast<float>(view->height());
  const float px = static_cast<float>(at.x()) + 0.5f, py = static_cast<float>(at.y()) + 0.5f;
  const float radius = static_cast<float>(std::max(5.0, 0.5 * point_size + 2.0));
  std::vector<std::pair<int, float>> near;  // index, squared pixels
  double front = 1e30;
  for (std::size_t i = 0; i < space.points.size(); ++i) {
    const Eigen::Vector4f c = m * space.points[i].homogeneous();
    if (!(c.w() > 0.0f)) continue;
    const float dx = half_w * (1.0f + c.x() / c.w()) - px;
    const float dy = half_h * (1.0f - c.y() / c.w()) - py;
    if (dx * dx + dy * dy > radius * radius) continue;
    near.emplace_back(static_cast<int>(i), dx * dx + dy * dy);
    front = std::min(front, ray.direction.dot(space.points[i].cast<double>() - ray.start));
  }
  int best = -1;
  float least = 1e30f;
  for (const auto& [i, pixels] : near) {
    const double t =
        ray.direction.dot(space.points[static_cast<std::size_t>(i)].cast<double>() - ray.start);
    if (t > front + 0.03 * std::abs(front) || pixels >= least) continue;
    least = pixels;
    best = i;
  }
  return best;
}

QString ViewerWindow::Impl::place_text(const Eigen::Vector3d& x) const {
  const char* unit = space.unit.c_str();
  QString out = space.map
                    ? text("  x %.2f, y %.2f, height %.2f %s\n", x.x(), x.y(), x.z(), unit)
                    : text("  right %.2f, ahead %.2f, up %.2f %s\n", x.x(), x.y(), x.z(), unit);
  const Eigen::Vector3d file = space.picture_from_reference.inverse() * x;
  out += text("  in the file's frame %.3f %.3f %.3f\n", file.x(), file.y(), file.z());
  return out;
}

QString ViewerWindow::Impl::patch_facts(int id, const Eigen::Vector3d& place) const {
  const PlanePatch* patch = result.surface ? result.surface->find(id) : nullptr;
  if (!patch) return text("patch %d\n", id);
  QString out = text("patch %d: %s, %s\n", id, std::string(to_string(patch->kind)).c_str(),
                     std::string(to_string(patch->status)).c_str());
  if (!patch->reason.empty()) out += "  " + from(patch->reason) + "\n";
  out += text("  grade %.2f deg, cross slope %.2f deg\n", patch->grade * kDegrees,
              patch->bank * kDegrees);
  out += text("  %d points", patch->inliers);
  if (patch->noise > 0.0) out += text(", noise %.3f %s", patch->noise, space.unit.c_str());
  const Eigen::Vector3d x = space.picture_from_reference.inverse() * place;
  const double variance = patch->plane.height_variance(x);
  if (variance > 0.0) {
    out += text("\n  height known here to %.3f %s", std::sqrt(variance), space.unit.c_str());
  }
  if (!patch->refinement.empty()) out += "\n  refinement " + from(patch->refinement);
  for (const PatchLink& link : result.surface->links) {
    if (link.a != id && link.b != id) continue;
    out += text("\n  link to %d: step %.3f %s, %.2f deg%s", link.a == id ? link.b : link.a,
                link.a == id ? link.height_step : -link.height_step, space.unit.c_str(),
                link.angle * kDegrees, link.valid ? "" : ", not used");
    if (!link.valid && !link.reason.empty()) out += ": " + from(link.reason);
  }
  return out + "\n";
}

QString ViewerWindow::Impl::true_place(const PlacedVehicle& placed) const {
  if (space.truth.empty() || !content.truth || !content.camera) return {};
  for (const TruthFrame& truth : content.truth->frames) {
    if (truth.id != content.frame) continue;
    for (const VehicleFrame& frame : result.vehicles->frames) {
      if (frame.id != content.frame) continue;
      for (const Match& match : match_vehicles(truth.vehicles, frame.vehicles, *content.camera)) {
        const VehicleEstimate& v = frame.vehicles[match.estimate];
        if (v.id != placed.id) continue;
        const TruthVehicle& t = truth.vehicles[match.truth];
        return text("  true vehicle %d: its centre is %.2f %s away\n", t.id,
                    (t.pose.center() - v.pose.center()).norm(), space.unit.c_str());
      }
    }
  }
  return {};
}

QString ViewerWindow::Impl::vehicle_facts(const PlacedVehicle& placed) const {
  const char* unit = space.unit.c_str();
  const QString status = from(std::string(to_string(placed.status)));
  QString out = from(placed.name) + text(" in frame %d", content.frame);
  // The number in its name is the same in all frames.
  if (!out.contains(text(" %d in ", placed.id))) out += text(" (id %d there)", placed.id);
  out += ": " + status + "\n";
  const Dimensions& d = placed.box.dimensions;
  out += text("  %.2f %s from the camera\n", placed.range, unit);
  out += place_text(placed.box.bottom_center());
  out += text("  length %.2f, width %.2f, height %.2f %s\n", d.length, d.width, d.height, unit);
  for (const VehicleFrame& frame : result.vehicles->frames) {
    if (frame.id != content.frame) continue;
    for (const VehicleEstimate& v : frame.vehicles) {
      if (v.id != placed.id) continue;
      if (!v.reason.empty()) out += "  " + from(v.reason) + "\n";
      const Eigen::Vector3d sigma = v.covariance.diagonal().head<3>().cwiseMax(0.0).cwiseSqrt();
      if (sigma.allFinite() && sigma.norm() > 0.0) {
        out += text("  centre known to %.2f, %.2f, %.2f %s (camera's x, y, z)\n", sigma.x(),
                    sigma.y(), sigma.z(), unit);
      }
      out += text("  rotation_y %.1f deg\n",
                  rotation_y(v.pose.camera_from_vehicle.rotation_matrix()) * kDegrees);
      if (!v.plane_source.empty()) {
        out += "  stands on " + from(v.plane_source);
        if (std::isfinite(v.plane_sigma_height)) {
          out += text(", height known to %.3f %s", v.plane_sigma_height, unit);
        }
        out += "\n";
      }
      if (std::isfinite(v.reprojection_rmse_px)) {
        out += text("  keypoints fit to %.2f px\n", v.reprojection_rmse_px);
      }
    }
  }
  return out + true_place(placed);
}

QString ViewerWindow::Impl::point_facts(int i) const {
  const auto at = static_cast<std::size_t>(i);
  const std::uint32_t row = space.kept[at];
  const RoadCloud& cloud = *result.cloud;
  QString out = text("point %u\n", row) + place_text(space.points[at].cast<double>());
  if (!cloud.sigmas.empty()) {
    out += text("  sigma %.3f %s\n", cloud.sigmas[row], space.unit.c_str());
  }
  if (!cloud.colors.empty()) {
    const auto& c = cloud.colors[row];
    out += text("  colour %d %d %d\n", c[0], c[1], c[2]);
  }
  for (const auto& [name, values] : cloud.labels) {
    out += "  " + from(name) + text(" %d\n", values[row]);
  }
  for (const auto& [name, values] : cloud.scalars) {
    out += "  " + from(name) + text(" %g\n", values[row]);
  }
  return out;
}

QString ViewerWindow::Impl::overview() const {
  QString out = "Click a point, a patch or a vehicle; h shows the keys.\n\n";
  out += from(content_summary(content, space)) + "\n";
  if (result.run && !result.run->metric && !result.run->cameras.empty()) {
    out += "the result is up to scale\n";
  } else if (result.run && result.run->scale_sigma > 0.0) {
    out += text("scale known to %.1f %%\n", 100.0 * result.run->scale_sigma);
  }
  for (const PlacedVehicle& vehicle : space.vehicles) {
    out += "  " + from(vehicle.name) +
           text(": %.1f %s, %s\n", vehicle.range, space.unit.c_str(),
                std::string(to_string(vehicle.status)).c_str());
  }
  return out;
}

void ViewerWindow::Impl::pick(const QPoint& at) {
  const Ray ray = ray_at(at);
  const PlacedVehicle* vehicle = nullptr;
  double vehicle_t = 1e30;
  if (shown.show_vehicles || shown.show_boxes) {
    for (const PlacedVehicle& candidate : space.vehicles) {
      const double t = hit_box(ray, candidate.box);
      if (t < 0.0 || t >= vehicle_t) continue;
      vehicle_t = t;
      vehicle = &candidate;
    }
  }
  const PlacedPatch* patch = nullptr;
  double patch_t = 1e30;
  if (shown.show_patches) {
    for (const PlacedPatch& candidate : space.patches) {
      const double t = hit_patch(ray, candidate);
      if (t < 0.0 || t >= patch_t) continue;
      patch_t = t;
      patch = &candidate;
    }
  }
  const int point = shown.show_points ? point_at(at, ray) : -1;
  Eigen::Vector3d place = Eigen::Vector3d::Zero();
  double point_t = 1e30;
  if (point >= 0) {
    place = space.points[static_cast<std::size_t>(point)].cast<double>();
    point_t = ray.direction.dot(place - ray.start);
  }
  if (vehicle && vehicle_t <= std::min(point_t, patch_t)) {
    mark(ray.start + vehicle_t * ray.direction);
    facts->setPlainText(vehicle_facts(*vehicle));
  } else if (point >= 0) {
    mark(place);
    QString text_of_point = point_facts(point);
    const auto of_patch = result.cloud->labels.find("patch");
    int id = patch ? patch->id : -1;
    if (of_patch != result.cloud->labels.end()) {
      id = of_patch->second[space.kept[static_cast<std::size_t>(point)]];
    }
    if (id >= 0 && result.surface) text_of_point += "\n" + patch_facts(id, place);
    facts->setPlainText(text_of_point);
  } else if (patch) {
    place = ray.start + patch_t * ray.direction;
    mark(place);
    facts->setPlainText("on a patch\n" + place_text(place) + "\n" + patch_facts(patch->id, place));
  } else {
    clear_pick();
    facts->setPlainText("nothing here");
  }
  render();
}

void ViewerWindow::Impl::mark(const Eigen::Vector3d& place) {
  clear_pick();
  vtkNew<vtkPoints> points;
  points->InsertNextPoint(place.data());
  vtkNew<vtkCellArray> cells;
  const vtkIdType first = 0;
  cells->InsertNextCell(1, &first);
  vtkNew<vtkPolyData> data;
  data->SetPoints(points);
  data->SetVerts(cells);
  vtkNew<vtkPolyDataMapper> mapper;
  mapper->SetInputData(data);
  marker = vtkSmartPointer<vtkActor>::New();
  marker->SetMapper(mapper);
  marker->GetProperty()->SetColor(0.9, 0.0, 0.6);
  marker->GetProperty()->LightingOff();
  marker->GetProperty()->SetPointSize(static_cast<float>(11 * view->devicePixelRatioF()));
  marker->GetProperty()->RenderPointsAsSpheresOn();
  labels->AddActor(marker);
}

void ViewerWindow::Impl::clear_pick() {
  if (marker) labels->RemoveActor(marker);
  marker = nullptr;
}

}  // namespace camber
