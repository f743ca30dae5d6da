// The 3D scene: which of its parts are drawn, of which frame, and from where.

#include "detail/viewer_state.h"

namespace camber {

void ViewerWindow::Impl::list_frames() {
  std::set<int> ids;
  if (result.run) {
    for (const auto& camera : result.run->cameras) ids.insert(camera.id);
  }
  if (result.vehicles) {
    for (const VehicleFrame& frame : result.vehicles->frames) ids.insert(frame.id);
  }
  frames.assign(ids.begin(), ids.end());
}

void ViewerWindow::Impl::list_colors() {
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

void ViewerWindow::Impl::place_frame(int id) {
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

void ViewerWindow::Impl::build_layers(const std::function<bool(SceneElement)>& wanted) {
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

void ViewerWindow::Impl::build_names() {
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

bool ViewerWindow::Impl::is_of_frame(SceneElement element) {
  return element == SceneElement::kVehicles || element == SceneElement::kBoxes ||
         element == SceneElement::kPlanes || element == SceneElement::kTruth;
}

bool& ViewerWindow::Impl::switch_of(SceneElement element) {
  return shown.*scene_switches()[static_cast<std::size_t>(element)].shown;
}

bool ViewerWindow::Impl::has(SceneElement element) const {
  return std::any_of(layers.begin(), layers.end(),
                     [&](const SceneLayer& layer) { return layer.element == element; });
}

void ViewerWindow::Impl::apply_switches() {
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

void ViewerWindow::Impl::render() {
  renderer->ResetCameraClippingRange();
  gl->Render();
}

void ViewerWindow::Impl::toggle(SceneElement element) {
  switch_of(element) = !switch_of(element);
  apply_switches();
  render();
}

void ViewerWindow::Impl::set_point_size(double pixels) {
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

void ViewerWindow::Impl::set_color(const std::string& name) {
  try {
    const int frame = content.frame;
    PictureSpace colored = make_picture_space(content, true, PointColor::parse(name));
    space = std::move(colored);
    content.frame = frame;
    options.color_name = name;
  } catch (const NoAnswerError& error) {
    show_message(error.what());
  }
  build_layers([](SceneElement element) { return element == SceneElement::kPoints; });
  const QSignalBlocker quiet(color_box);
  color_box->setCurrentText(from(options.color_name));
  draw_bar();
  render();
}

void ViewerWindow::Impl::set_frame(int index) {
  if (frames.empty()) return;
  index = std::clamp(index, 0, static_cast<int>(frames.size()) - 1);
  place_frame(frames[static_cast<std::size_t>(index)]);
  build_layers(is_of_frame);
  const QSignalBlocker quiet(frame_slider);
  frame_slider->setValue(index);
  load_image();
  show_summary();
  clear_pick();
  facts->setPlainText(overview());
  render();
}

int ViewerWindow::Impl::frame_index() const {
  const auto found = std::find(frames.begin(), frames.end(), content.frame);
  return found == frames.end() ? 0 : static_cast<int>(found - frames.begin());
}

Box2 ViewerWindow::Impl::free_area(int width, int height) const {
  const double taken = bar->isVisibleTo(view) ? bar->width() + 30.0 : 20.0;
  return {20.0, 30.0, std::max(0.5 * width, width - taken), height - 20.0};
}

void ViewerWindow::Impl::set_view(SceneView kind) {
  const int width = std::max(64, view->width()), height = std::max(64, view->height());
  SceneCamera camera;
  const SceneGrid grid = make_scene_grid(space);
  const Box2 free = free_area(width, height);
  if (kind == SceneView::kDriver) {
    try {
      camera = driver_camera(content, space, width, height);
    } catch (const NoAnswerError& error) {
      show_message(error.what());
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

void ViewerWindow::Impl::set_view_from_above() {
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

void ViewerWindow::Impl::aim(const SceneCamera& camera) {
  vtkCamera* to = renderer->GetActiveCamera();
  to->SetParallelProjection(camera.parallel);
  apply_camera(camera, space, to);
  render();
}

}  // namespace camber
