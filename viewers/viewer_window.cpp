#include "viewer_window.h"

#include <QVTKOpenGLNativeWidget.h>
#include <vtkActor.h>
#include <vtkBillboardTextActor3D.h>
#include <vtkCallbackCommand.h>
#include <vtkCamera.h>
#include <vtkCellArray.h>
#include <vtkGenericOpenGLRenderWindow.h>
#include <vtkInteractorStyleTrackballCamera.h>
#include <vtkMatrix4x4.h>
#include <vtkNew.h>
#include <vtkObjectFactory.h>
#include <vtkPoints.h>
#include <vtkPolyData.h>
#include <vtkPolyDataMapper.h>
#include <vtkProperty.h>
#include <vtkRenderWindowInteractor.h>
#include <vtkRenderer.h>
#include <vtkRendererCollection.h>
#include <vtkTextProperty.h>

#include <QApplication>
#include <QBuffer>
#include <QCheckBox>
#include <QComboBox>
#include <QGridLayout>
#include <QGroupBox>
#include <QKeyEvent>
#include <QLabel>
#include <QPainter>
#include <QPlainTextEdit>
#include <QSlider>
#include <QSplitter>
#include <QStatusBar>
#include <QTimer>
#include <QVBoxLayout>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <set>
#include <system_error>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/render/color_map.h"
#include "camber/render/frame_overlay.h"
#include "camber/render/picture_file.h"
#include "camber/render/scene_actors.h"
#include "camber/render/scene_camera.h"

namespace camber {
namespace {

constexpr double kDegrees = 180.0 / M_PI;

/// The key of each switch.
QChar key_of(SceneElement element) {
  switch (element) {
    case SceneElement::kGrid:
      return 'g';
    case SceneElement::kTruthCloud:
      return 'd';
    case SceneElement::kPoints:
      return 'p';
    case SceneElement::kVehicles:
      return 'v';
    case SceneElement::kBoxes:
      return 'b';
    case SceneElement::kPlanes:
      return 'e';
    case SceneElement::kTruth:
      return 't';
    case SceneElement::kCameras:
      return 'c';
    case SceneElement::kPatches:
      return 'a';
    case SceneElement::kNormals:
      return 'n';
    case SceneElement::kLinks:
      return 'l';
  }
  return {};
}

/// Turns about the vertical and tilts, never rolls: a road stays level.
class LevelStyle : public vtkInteractorStyleTrackballCamera {
 public:
  static LevelStyle* New();
  vtkTypeMacro(LevelStyle, vtkInteractorStyleTrackballCamera)

      void Rotate() override {
    if (!CurrentRenderer) return;
    const int* now = Interactor->GetEventPosition();
    const int* last = Interactor->GetLastEventPosition();
    const int* size = CurrentRenderer->GetRenderWindow()->GetSize();
    vtkCamera* camera = CurrentRenderer->GetActiveCamera();
    camera->SetViewUp(0.0, 0.0, 1.0);
    camera->Azimuth(-200.0 * (now[0] - last[0]) / std::max(1, size[0]));
    double along[3];
    camera->GetDirectionOfProjection(along);
    const double tilt = std::asin(std::clamp(-along[2], -1.0, 1.0)) * kDegrees;
    const double wanted =
        std::clamp(tilt - 120.0 * (now[1] - last[1]) / std::max(1, size[1]), -5.0, 89.0);
    camera->Elevation(wanted - tilt);
    camera->OrthogonalizeViewUp();
    camera->SetViewUp(0.0, 0.0, 1.0);
    CurrentRenderer->ResetCameraClippingRange();
    Interactor->Render();
  }
};
vtkStandardNewMacro(LevelStyle)

    QPixmap to_pixmap(const Image& image) {
  const QImage wrapped(image.data.data(), image.width, image.height, 3 * image.width,
                       QImage::Format_RGB888);
  return QPixmap::fromImage(wrapped);  // copies
}

QString text(const char* format, ...) __attribute__((format(printf, 1, 2)));
QString text(const char* format, ...) {
  va_list values;
  va_start(values, format);
  const QString out = QString::vasprintf(format, values);
  va_end(values);
  return out;
}

QString from(const std::string& words) { return QString::fromStdString(words); }

struct Ray {
  Eigen::Vector3d start, way;  // way: unit
};

/// Metres along the ray to a vehicle's box; negative: misses it.
double hit_box(const Ray& ray, const OrientedBox& box) {
  const SE3 inside = box.camera_from_vehicle.inverse();
  const Eigen::Vector3d start = inside * ray.start, way = inside.rotation() * ray.way;
  const Dimensions& d = box.dimensions;
  const double low[3] = {-0.5 * d.length, 0.0, -0.5 * d.width};
  const double high[3] = {0.5 * d.length, d.height, 0.5 * d.width};
  double enter = 0.0, leave = 1e30;
  for (int k = 0; k < 3; ++k) {
    if (std::abs(way[k]) < 1e-12) {
      if (start[k] < low[k] || start[k] > high[k]) return -1.0;
      continue;
    }
    const double a = (low[k] - start[k]) / way[k], b = (high[k] - start[k]) / way[k];
    enter = std::max(enter, std::min(a, b));
    leave = std::min(leave, std::max(a, b));
  }
  return enter <= leave ? enter : -1.0;
}

/// Metres along the ray to a patch; negative: misses it.
double hit_patch(const Ray& ray, const PlacedPatch& patch) {
  const double slope = patch.normal.dot(ray.way);
  if (std::abs(slope) < 1e-9) return -1.0;
  const double t = patch.normal.dot(patch.middle - ray.start) / slope;
  if (!(t > 0.0)) return -1.0;
  const Eigen::Vector3d x = ray.start + t * ray.way;
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

struct ViewerWindow::Impl {
  ViewerWindow* window = nullptr;
  LoadedResult result;
  ViewerOptions options;
  PictureContent content;
  PictureSpace space;
  ScenePictureOptions shown;  // its switches only
  std::vector<int> frames;    // ids
  std::vector<std::string> colors;
  double point_size = 2.0;
  bool grade = false;

  QVTKOpenGLNativeWidget* view = nullptr;
  vtkNew<vtkGenericOpenGLRenderWindow> gl;
  vtkNew<vtkRenderer> renderer;
  vtkNew<vtkRenderer> labels;  // over the scene: names and the picked place
  std::vector<SceneLayer> layers;
  std::vector<vtkSmartPointer<vtkBillboardTextActor3D>> names;
  vtkSmartPointer<vtkActor> marker;
  std::map<SceneElement, QCheckBox*> boxes;
  QLabel* image = nullptr;
  QPixmap photo;
  QSlider* frame_slider = nullptr;
  QLabel* frame_label = nullptr;
  QSlider* size_slider = nullptr;
  QComboBox* color_box = nullptr;
  QPlainTextEdit* facts = nullptr;
  QLabel* bar = nullptr;
  QLabel* help = nullptr;
  std::optional<QPoint> pressed;
  bool untouched = true;  // the scene is fitted again when the window's size changes

  // ---- contents

  void list_frames() {
    std::set<int> ids;
    if (result.run) {
      for (const auto& camera : result.run->cameras) ids.insert(camera.id);
    }
    if (result.vehicles) {
      for (const VehicleFrame& frame : result.vehicles->frames) ids.insert(frame.id);
    }
    frames.assign(ids.begin(), ids.end());
  }

  void list_colors() {
    colors = {"height"};
    if (!result.cloud) return;
    const RoadCloud& cloud = *result.cloud;
    if (!cloud.sigmas.empty()) colors.push_back("sigma");
    if (!cloud.colors.empty()) colors.push_back("image");
    if (result.truth_cloud) colors.push_back("error");
    for (const auto& label : cloud.labels) colors.push_back(label.first);
    for (const auto& scalar : cloud.scalars) colors.push_back(scalar.first);
    if (std::find(colors.begin(), colors.end(), options.color_name) == colors.end()) {
      colors.push_back(options.color_name);
    }
  }

  /// Vehicles and truth of another frame; points and patches stay as they are.
  void place_frame(int id) {
    content.frame = id;
    PictureContent light = content;
    RoadCloud empty;
    if (result.cloud) {
      empty.frame = result.cloud->frame;
      empty.metric = result.cloud->metric;
      empty.origin = result.cloud->origin;
      light.cloud = &empty;
    }
    light.truth_cloud = nullptr;
    space.vehicles.clear();
    space.truth.clear();
    try {
      PictureSpace moved = make_picture_space(light, true, {});
      space.vehicles = std::move(moved.vehicles);
      space.truth = std::move(moved.truth);
      space.current_camera = moved.current_camera;
    } catch (const NoAnswerError&) {
      // Nothing but points: there is nothing to move.
    }
  }

  void build_layers(const std::function<bool(SceneElement)>& wanted) {
    for (SceneLayer& layer : layers) {
      if (!wanted(layer.element)) continue;
      for (const auto& actor : layer.actors) renderer->RemoveActor(actor.get());
      layer.actors.clear();
    }
    layers.erase(std::remove_if(layers.begin(), layers.end(),
                                [](const SceneLayer& layer) { return layer.actors.empty(); }),
                 layers.end());
    SceneStyle style;
    style.line_unit = view->devicePixelRatioF();
    style.point_size = point_size * view->devicePixelRatioF();
    for (SceneLayer& layer : make_scene_layers(content, space, style, wanted)) {
      for (const auto& actor : layer.actors) renderer->AddActor(actor.get());
      layers.push_back(std::move(layer));
    }
    if (wanted(SceneElement::kVehicles)) build_names();
    apply_switches();
  }

  void build_names() {
    for (const auto& name : names) labels->RemoveActor(name);
    names.clear();
    for (const PlacedVehicle& vehicle : space.vehicles) {
      auto label = vtkSmartPointer<vtkBillboardTextActor3D>::New();
      label->SetInput(
          (vehicle.name + "  " + format_number(vehicle.range, 1) + " " + space.unit).c_str());
      const Eigen::Vector3d top = vehicle.box.camera_from_vehicle *
                                  Eigen::Vector3d(0.0, vehicle.box.dimensions.height + 0.3, 0.0);
      label->SetPosition(top.x(), top.y(), top.z());
      vtkTextProperty* font = label->GetTextProperty();
      font->SetFontSize(static_cast<int>(13 * view->devicePixelRatioF()));
      font->SetBold(true);
      font->SetColor(0.1, 0.1, 0.12);
      font->SetBackgroundColor(1, 1, 1);
      font->SetBackgroundOpacity(0.8);
      font->SetJustificationToCentered();
      labels->AddActor(label);
      names.push_back(label);
    }
  }

  static bool is_of_frame(SceneElement element) {
    return element == SceneElement::kVehicles || element == SceneElement::kBoxes ||
           element == SceneElement::kPlanes || element == SceneElement::kTruth;
  }

  bool& switch_of(SceneElement element) {
    return shown.*scene_switches()[static_cast<std::size_t>(element)].shown;
  }

  bool has(SceneElement element) const {
    return std::any_of(layers.begin(), layers.end(),
                       [&](const SceneLayer& layer) { return layer.element == element; });
  }

  void apply_switches() {
    for (const SceneLayer& layer : layers) {
      for (const auto& actor : layer.actors) actor->SetVisibility(switch_of(layer.element));
    }
    const bool named = shown.show_vehicles || shown.show_boxes;
    for (const auto& name : names) name->SetVisibility(named);
    for (const auto& [element, box] : boxes) {
      const QSignalBlocker quiet(box);
      box->setChecked(has(element) && switch_of(element));
      box->setEnabled(has(element));
    }
  }

  void render() {
    renderer->ResetCameraClippingRange();
    gl->Render();
  }

  void toggle(SceneElement element) {
    switch_of(element) = !switch_of(element);
    apply_switches();
    render();
  }

  void set_point_size(double pixels) {
    point_size = std::clamp(pixels, 1.0, 20.0);
    for (const SceneLayer& layer : layers) {
      if (layer.element != SceneElement::kPoints && layer.element != SceneElement::kTruthCloud) {
        continue;
      }
      for (const auto& actor : layer.actors) {
        actor->GetProperty()->SetPointSize(
            static_cast<float>(point_size * view->devicePixelRatioF()));
      }
    }
    const QSignalBlocker quiet(size_slider);
    size_slider->setValue(static_cast<int>(std::lround(point_size)));
    render();
  }

  void set_color(const std::string& name) {
    try {
      const int frame = content.frame;
      PictureSpace colored = make_picture_space(content, true, PointColor::parse(name));
      space = std::move(colored);
      content.frame = frame;
      options.color_name = name;
    } catch (const NoAnswerError& error) {
      say(error.what());
    }
    build_layers([](SceneElement element) { return element == SceneElement::kPoints; });
    const QSignalBlocker quiet(color_box);
    color_box->setCurrentText(from(options.color_name));
    draw_bar();
    render();
  }

  void set_frame(int index) {
    if (frames.empty()) return;
    index = std::clamp(index, 0, static_cast<int>(frames.size()) - 1);
    place_frame(frames[static_cast<std::size_t>(index)]);
    build_layers(is_of_frame);
    const QSignalBlocker quiet(frame_slider);
    frame_slider->setValue(index);
    load_image();
    say_summary();
    clear_pick();
    facts->setPlainText(overview());
    render();
  }

  int frame_index() const {
    const auto found = std::find(frames.begin(), frames.end(), content.frame);
    return found == frames.end() ? 0 : static_cast<int>(found - frames.begin());
  }

  // ---- what is beside the scene

  void say(const std::string& words) { window->statusBar()->showMessage(from(words)); }

  void say_summary() {
    frame_label->setText(text("frame %d", content.frame));
    frame_label->setVisible(!frames.empty());
    frame_slider->setVisible(!frames.empty());
    say(content_summary(content, space));
  }

  void load_image() {
    photo = QPixmap();
    if (!result.scene) {
      image->setText(frames.empty() ? "" : "no images: start with --scene");
      image->setVisible(!frames.empty());
      return;
    }
    try {
      OverlayOptions overlay;
      overlay.show_grade = grade && result.surface.has_value();
      overlay.show_ellipses = true;
      photo = to_pixmap(draw_frame_overlay(result, content.frame, overlay));
      fit_image();
    } catch (const Error& error) {
      image->setText(from(error.what()));
    }
  }

  void fit_image() {
    if (photo.isNull()) return;
    image->setPixmap(photo.scaled(image->size(), Qt::KeepAspectRatio, Qt::SmoothTransformation));
  }

  void draw_bar() {
    bar->setVisible(space.has_color_bar);
    if (!space.has_color_bar) return;
    constexpr double kText = 16.0;
    double width = 7.0 * kText;
    for (const std::string& line : space.color_title) {
      width = std::max(width, Canvas::text_size(line, kText).x() + 1.2 * kText);
    }
    const double top = 1.2 * kText * static_cast<double>(space.color_title.size()) + 0.4 * kText;
    Image picture =
        make_picture(static_cast<int>(width), static_cast<int>(top + 13.0 * kText), 255);
    Canvas canvas(picture);
    draw_color_bar(canvas, {0.6 * kText, top, 1.7 * kText, top + 12.4 * kText},
                   space.color_range.low, space.color_range.high, space.color_title, kText, kInk,
                   space.color_scale);
    bar->setPixmap(to_pixmap(picture));
    bar->adjustSize();
    place_overlays();
  }

  void place_overlays() {
    bar->move(view->width() - bar->width() - 10, 10);
    help->adjustSize();
    help->move((view->width() - help->width()) / 2, (view->height() - help->height()) / 2);
  }

  static QString help_text() {
    QString out = "<table cellspacing='4'>";
    const auto row = [&](const QString& key, const QString& what) {
      out += "<tr><td><b>" + key + "</b>&nbsp;&nbsp;</td><td>" + what + "</td></tr>";
    };
    row("click", "facts about a point, patch or vehicle");
    row("drag", "turn; with the middle button: move; wheel or right button: nearer, farther");
    for (const SceneSwitch& entry : scene_switches()) {
      row(key_of(entry.element), QString(entry.text) + " on, off");
    }
    row("m", "next colours of the points");
    row("+ &minus;", "larger, smaller points");
    row("&larr; &rarr;", "frame before, after");
    row("1 2 3 4", "oblique, side, from above, driver's view");
    row("i", "grade of the road in the image");
    row("s", "picture of the scene into a file; S: of the window");
    row("h", "this help");
    row("q", "quit");
    return out + "</table>";
  }

  // ---- views

  /// What the colour bar leaves of the view, pixels.
  Box2 free_area(int width, int height) const {
    const double taken = bar->isVisibleTo(view) ? bar->width() + 30.0 : 20.0;
    return {20.0, 30.0, std::max(0.5 * width, width - taken), height - 20.0};
  }

  void set_view(SceneView kind) {
    const int width = std::max(64, view->width()), height = std::max(64, view->height());
    SceneCamera camera;
    const SceneGrid grid = make_scene_grid(space);
    const Box2 free = free_area(width, height);
    if (kind == SceneView::kDriver) {
      try {
        camera = driver_camera(content, space, width, height);
      } catch (const NoAnswerError& error) {
        say(error.what());
        return;
      }
    } else if (kind == SceneView::kSide) {
      camera = side_camera(space, width, height);
      fit_camera(content_corners(space, grid, true), free, &camera);
    } else {
      camera = oblique_camera(shown.azimuth, shown.elevation, width, height);
      fit_camera(content_corners(space, grid, false), free, &camera);
    }
    aim(camera);
  }

  void set_view_from_above() {
    const int width = std::max(64, view->width()), height = std::max(64, view->height());
    // Ahead points up, or to the right where the window is wider than the content.
    SceneCamera camera = oblique_camera(0.0, 0.5 * M_PI - 1e-3, width, height);
    if (space.ahead.span() > space.right.span() && width > height) {
      camera = oblique_camera(-0.5 * M_PI, 0.5 * M_PI - 1e-3, width, height);
    }
    camera.parallel = true;
    fit_camera(content_corners(space, make_scene_grid(space), false), free_area(width, height),
               &camera);
    aim(camera);
  }

  void aim(const SceneCamera& camera) {
    vtkCamera* to = renderer->GetActiveCamera();
    to->SetParallelProjection(camera.parallel);
    apply_camera(camera, space, to);
    render();
  }

  // ---- picking

  Eigen::Matrix4d projection() const {
    vtkRenderer* scene = renderer;
    const vtkMatrix4x4* m = scene->GetActiveCamera()->GetCompositeProjectionTransformMatrix(
        static_cast<double>(view->width()) / std::max(1, view->height()), -1.0, 1.0);
    Eigen::Matrix4d out;
    for (int i = 0; i < 4; ++i) {
      for (int j = 0; j < 4; ++j) out(i, j) = m->GetElement(i, j);
    }
    return out;
  }

  Ray ray_at(const QPoint& at) const {
    const Eigen::Matrix4d back = projection().inverse();
    const double x = 2.0 * (at.x() + 0.5) / view->width() - 1.0;
    const double y = 1.0 - 2.0 * (at.y() + 0.5) / view->height();
    const Eigen::Vector3d near = (back * Eigen::Vector4d(x, y, -1.0, 1.0)).hnormalized();
    const Eigen::Vector3d far = (back * Eigen::Vector4d(x, y, 1.0, 1.0)).hnormalized();
    return {near, (far - near).normalized()};
  }

  /// The point drawn at a place: of those within five pixels and near the front the closest.
  int point_at(const QPoint& at, const Ray& ray) const {
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
      front = std::min(front, ray.way.dot(space.points[i].cast<double>() - ray.start));
    }
    int best = -1;
    float least = 1e30f;
    for (const auto& [i, pixels] : near) {
      const double t =
          ray.way.dot(space.points[static_cast<std::size_t>(i)].cast<double>() - ray.start);
      if (t > front + 0.03 * std::abs(front) || pixels >= least) continue;
      least = pixels;
      best = i;
    }
    return best;
  }

  QString place_text(const Eigen::Vector3d& x) const {
    const char* unit = space.unit.c_str();
    QString out = space.map
                      ? text("  x %.2f, y %.2f, height %.2f %s\n", x.x(), x.y(), x.z(), unit)
                      : text("  right %.2f, ahead %.2f, up %.2f %s\n", x.x(), x.y(), x.z(), unit);
    Eigen::Vector3d file = space.picture_from_reference.inverse() * x;
    if (space.map && result.cloud) file += result.cloud->origin;
    out += text("  in the file's frame %.3f %.3f %.3f\n", file.x(), file.y(), file.z());
    return out;
  }

  QString patch_facts(int id, const Eigen::Vector3d& place) const {
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

  QString vehicle_facts(const PlacedVehicle& placed) const {
    const char* unit = space.unit.c_str();
    QString out = from(placed.name) + text(" in frame %d: %s\n", content.frame,
                                           std::string(to_string(placed.status)).c_str());
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
    for (const PlacedVehicle& truth : space.truth) {
      if (truth.id != placed.id) continue;
      out += text("  true centre %.2f %s away\n", (truth.box.center() - placed.box.center()).norm(),
                  unit);
    }
    return out;
  }

  QString point_facts(int i) const {
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

  /// What the side text says where nothing is picked.
  QString overview() const {
    QString out = "Click a point, a patch or a vehicle; h shows the keys.\n\n";
    out += from(content_summary(content, space)) + "\n";
    if (result.run && result.run->scale_sigma > 0.0) {
      out += text("scale known to %.1f %%\n", 100.0 * result.run->scale_sigma);
    }
    for (const PlacedVehicle& vehicle : space.vehicles) {
      out += "  " + from(vehicle.name) +
             text(": %.1f %s, %s\n", vehicle.range, space.unit.c_str(),
                  std::string(to_string(vehicle.status)).c_str());
    }
    return out;
  }

  void pick(const QPoint& at) {
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
      point_t = ray.way.dot(place - ray.start);
    }
    if (vehicle && vehicle_t <= std::min(point_t, patch_t)) {
      mark(ray.start + vehicle_t * ray.way);
      facts->setPlainText(vehicle_facts(*vehicle));
    } else if (point >= 0) {
      mark(place);
      QString words = point_facts(point);
      const auto of_patch = result.cloud->labels.find("patch");
      int id = patch ? patch->id : -1;
      if (of_patch != result.cloud->labels.end()) {
        id = of_patch->second[space.kept[static_cast<std::size_t>(point)]];
      }
      if (id >= 0 && result.surface) words += "\n" + patch_facts(id, place);
      facts->setPlainText(words);
    } else if (patch) {
      place = ray.start + patch_t * ray.way;
      mark(place);
      facts->setPlainText("on a patch\n" + place_text(place) + "\n" +
                          patch_facts(patch->id, place));
    } else {
      clear_pick();
      facts->setPlainText("nothing here");
    }
    render();
  }

  void mark(const Eigen::Vector3d& place) {
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

  void clear_pick() {
    if (marker) labels->RemoveActor(marker);
    marker = nullptr;
  }

  // ---- files

  void save_next(bool whole_window) {
    std::filesystem::path path;
    std::error_code error;
    for (int i = 1;; ++i) {
      path = options.snapshots + "-" + std::to_string(i) + ".png";
      if (!std::filesystem::exists(path, error)) break;
    }
    try {
      save(path, whole_window);
      say("wrote " + path.string());
    } catch (const Error& failure) {
      say(failure.what());
    }
  }

  void save(const std::filesystem::path& path, bool whole_window) {
    render();
    QImage picture = view->grabFramebuffer();
    if (whole_window) {
      picture = window->grab().toImage();
    } else if (bar->isVisible()) {
      QPainter painter(&picture);
      painter.drawPixmap(bar->pos(), bar->pixmap(Qt::ReturnByValue));
    }
    QByteArray bytes;
    QBuffer buffer(&bytes);
    buffer.open(QIODevice::WriteOnly);
    if (!picture.convertToFormat(QImage::Format_RGB888).save(&buffer, "PNG")) {
      throw MachineError("the picture of the window cannot be encoded");
    }
    write_file_atomically(path, bytes.toStdString());
  }

  // ---- events

  bool on_key(const QKeyEvent& event) {
    if (event.modifiers() & (Qt::ControlModifier | Qt::AltModifier | Qt::MetaModifier)) {
      return false;
    }
    switch (event.key()) {
      case Qt::Key_Left:
        set_frame(frame_index() - 1);
        return true;
      case Qt::Key_Right:
        set_frame(frame_index() + 1);
        return true;
      case Qt::Key_Plus:
      case Qt::Key_Equal:
        set_point_size(point_size + 1.0);
        return true;
      case Qt::Key_Minus:
        set_point_size(point_size - 1.0);
        return true;
      case Qt::Key_1:
      case Qt::Key_R:
        set_view(SceneView::kOblique);
        return true;
      case Qt::Key_2:
        untouched = false;
        set_view(SceneView::kSide);
        return true;
      case Qt::Key_3:
        untouched = false;
        set_view_from_above();
        return true;
      case Qt::Key_4:
        untouched = false;
        shown.show_cameras = false;  // from within they only stand in the way
        apply_switches();
        set_view(SceneView::kDriver);
        return true;
      case Qt::Key_I:
        grade = !grade;
        load_image();
        return true;
      case Qt::Key_S:
        save_next((event.modifiers() & Qt::ShiftModifier) != 0);
        return true;
      case Qt::Key_H:
      case Qt::Key_F1:
      case Qt::Key_Question:
        help->setVisible(!help->isVisible());
        place_overlays();
        return true;
      case Qt::Key_Escape:
        help->hide();
        clear_pick();
        facts->setPlainText(overview());
        render();
        return true;
      case Qt::Key_Q:
        window->close();
        return true;
      case Qt::Key_M: {
        const auto now = std::find(colors.begin(), colors.end(), options.color_name);
        const auto index = static_cast<std::size_t>(now - colors.begin());
        set_color(colors[(index + 1) % colors.size()]);
        return true;
      }
      default:
        break;
    }
    const QString letter = event.text().toLower();
    for (const SceneSwitch& entry : scene_switches()) {
      if (letter != QString(key_of(entry.element))) continue;
      if (has(entry.element)) {
        toggle(entry.element);
      } else {
        say(std::string("there is nothing to show: no ") + entry.text);
      }
      return true;
    }
    return false;
  }
};

ViewerWindow::ViewerWindow(LoadedResult result, const ViewerOptions& options)
    : impl_(std::make_unique<Impl>()) {
  Impl& d = *impl_;
  d.window = this;
  d.result = std::move(result);
  d.options = options;
  d.content = d.result.content();
  if (options.frame) d.content.frame = *options.frame;
  d.content.up = options.up;
  d.space = make_picture_space(d.content, true, options.color);
  d.list_frames();
  d.list_colors();
  setWindowTitle(from(options.title + " - Camber"));
  resize(1400, 840);

  auto* split = new QSplitter(Qt::Horizontal, this);
  setCentralWidget(split);
  d.view = new QVTKOpenGLNativeWidget(split);
  d.view->setMinimumSize(320, 240);
  d.view->setFocusPolicy(Qt::StrongFocus);
  d.gl->SetMultiSamples(d.space.points.size() > 500000 ? 0 : 4);
  d.view->setRenderWindow(d.gl.Get());
  d.renderer->SetBackground(1, 1, 1);
  d.gl->SetNumberOfLayers(2);
  d.gl->AddRenderer(d.renderer);
  d.labels->SetLayer(1);
  d.labels->InteractiveOff();
  d.labels->SetActiveCamera(d.renderer->GetActiveCamera());
  d.gl->AddRenderer(d.labels);
  vtkNew<LevelStyle> style;
  d.view->interactor()->SetInteractorStyle(style);

  auto* side = new QWidget(split);
  auto* column = new QVBoxLayout(side);
  d.image = new QLabel(side);
  d.image->setAlignment(Qt::AlignCenter);
  d.image->setMinimumSize(240, 130);
  d.image->setSizePolicy(QSizePolicy::Ignored, QSizePolicy::Preferred);
  d.image->setWordWrap(true);
  column->addWidget(d.image);

  auto* frame_row = new QHBoxLayout;
  d.frame_label = new QLabel(side);
  d.frame_slider = new QSlider(Qt::Horizontal, side);
  d.frame_slider->setRange(0, std::max(0, static_cast<int>(d.frames.size()) - 1));
  d.frame_slider->setValue(d.frame_index());
  d.frame_slider->setEnabled(d.frames.size() > 1);
  frame_row->addWidget(d.frame_label);
  frame_row->addWidget(d.frame_slider);
  column->addLayout(frame_row);

  d.facts = new QPlainTextEdit(side);
  d.facts->setReadOnly(true);
  column->addWidget(d.facts, 1);

  auto* group = new QGroupBox("Show", side);
  auto* grid = new QGridLayout(group);
  int count = 0;
  for (const SceneSwitch& entry : scene_switches()) {
    auto* box =
        new QCheckBox(QString(entry.text) + " (" + QString(key_of(entry.element)) + ")", group);
    box->setObjectName(entry.name);
    grid->addWidget(box, count / 2, count % 2);
    ++count;
    d.boxes[entry.element] = box;
    const SceneElement element = entry.element;
    connect(box, &QCheckBox::toggled, this, [this, element] { impl_->toggle(element); });
  }
  column->addWidget(group);

  auto* color_row = new QHBoxLayout;
  color_row->addWidget(new QLabel("colour (m)", side));
  d.color_box = new QComboBox(side);
  for (const std::string& name : d.colors) d.color_box->addItem(from(name));
  d.color_box->setCurrentText(from(d.options.color_name));
  color_row->addWidget(d.color_box, 1);
  color_row->addWidget(new QLabel("size (+ -)", side));
  d.size_slider = new QSlider(Qt::Horizontal, side);
  d.size_slider->setRange(1, 20);
  color_row->addWidget(d.size_slider, 1);
  column->addLayout(color_row);
  split->setStretchFactor(0, 1);
  split->setStretchFactor(1, 0);
  split->setSizes({980, 420});

  const char* const plate = "background: rgba(255,255,255,225); color: #26282c; padding: 8px;";
  d.bar = new QLabel(d.view);
  d.bar->setAttribute(Qt::WA_TransparentForMouseEvents);
  d.help = new QLabel(Impl::help_text(), d.view);
  d.help->setStyleSheet(QString(plate) + "border: 1px solid #6e747c;");
  d.help->hide();

  // Half the gap between points is a size that closes them; see render_scene_picture().
  const double area = std::max(1e-6, d.space.right.span() * d.space.ahead.span());
  const double spacing =
      std::sqrt(area / static_cast<double>(std::max<std::size_t>(1, d.space.points.size())));
  const double pixels =
      900.0 / std::max(1e-6, std::max(d.space.right.span(), d.space.ahead.span()));
  d.point_size = std::clamp(std::round(0.7 * spacing * pixels), 2.0, 5.0);
  d.size_slider->setValue(static_cast<int>(d.point_size));
  d.build_layers([](SceneElement) { return true; });
  d.draw_bar();

  connect(d.frame_slider, &QSlider::valueChanged, this,
          [this](int index) { impl_->set_frame(index); });
  connect(d.size_slider, &QSlider::valueChanged, this,
          [this](int size) { impl_->set_point_size(size); });
  connect(d.color_box, QOverload<int>::of(&QComboBox::activated), this,
          [this](int index) { impl_->set_color(impl_->colors[static_cast<std::size_t>(index)]); });
  qApp->installEventFilter(this);

  show();
  d.view->setFocus();
  d.set_view(SceneView::kOblique);
  d.load_image();
  d.say_summary();
  d.facts->setPlainText(d.overview());
}

ViewerWindow::~ViewerWindow() { qApp->removeEventFilter(this); }

bool ViewerWindow::eventFilter(QObject* object, QEvent* event) {
  Impl& d = *impl_;
  auto* widget = qobject_cast<QWidget*>(object);
  if (!widget || widget->window() != this) return QMainWindow::eventFilter(object, event);
  switch (event->type()) {
    case QEvent::KeyPress:
      if (d.on_key(*static_cast<QKeyEvent*>(event))) return true;
      // VTK has keys of its own, some of which end the program.
      return widget == d.view;
    case QEvent::KeyRelease:
      return widget == d.view;
    case QEvent::MouseButtonPress: {
      const auto* mouse = static_cast<QMouseEvent*>(event);
      // An event that a widget does not want comes again for its parent.
      if (widget != d.view) break;
      d.untouched = false;
      d.pressed.reset();
      if (mouse->button() == Qt::LeftButton) d.pressed = mouse->pos();
      break;
    }
    case QEvent::MouseButtonRelease: {
      const auto* mouse = static_cast<QMouseEvent*>(event);
      if (widget == d.view && d.pressed && (mouse->pos() - *d.pressed).manhattanLength() <= 4) {
        d.pick(mouse->pos());
      }
      if (widget == d.view) d.pressed.reset();
      break;
    }
    case QEvent::Wheel:
      if (widget == d.view) d.untouched = false;
      break;
    case QEvent::Resize:
      if (widget == d.view) d.place_overlays();
      if (widget == d.view && d.untouched)
        QTimer::singleShot(0, this, [this] {
          if (impl_->untouched) impl_->set_view(SceneView::kOblique);
        });
      if (widget == d.image) d.fit_image();
      break;
    default:
      break;
  }
  return QMainWindow::eventFilter(object, event);
}

void ViewerWindow::save(const std::filesystem::path& path) { impl_->save(path, true); }

QWidget* ViewerWindow::scene_widget() { return impl_->view; }
bool ViewerWindow::shows(SceneElement element) const {
  return impl_->has(element) && impl_->switch_of(element);
}
int ViewerWindow::frame() const { return impl_->content.frame; }
double ViewerWindow::point_size() const { return impl_->point_size; }
std::string ViewerWindow::color() const { return impl_->options.color_name; }
std::string ViewerWindow::facts() const { return impl_->facts->toPlainText().toStdString(); }
std::string ViewerWindow::message() const { return statusBar()->currentMessage().toStdString(); }
bool ViewerWindow::help_shown() const { return impl_->help->isVisible(); }
bool ViewerWindow::has_image() const { return !impl_->photo.isNull(); }
const PictureSpace& ViewerWindow::space() const { return impl_->space; }

bool ViewerWindow::project(const Eigen::Vector3d& place, QPoint* at) const {
  const Eigen::Vector4d c = impl_->projection() * place.homogeneous();
  if (!(c.w() > 0.0)) return false;
  *at = QPoint(
      static_cast<int>(std::lround(0.5 * impl_->view->width() * (1.0 + c.x() / c.w()) - 0.5)),
      static_cast<int>(std::lround(0.5 * impl_->view->height() * (1.0 - c.y() / c.w()) - 0.5)));
  return true;
}

}  // namespace camber
