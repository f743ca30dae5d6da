#include "viewer_window.h"

#include "detail/viewer_state.h"

namespace camber {
namespace {

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

}  // namespace

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

bool ViewerWindow::Impl::on_key(const QKeyEvent& event) {
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
      show_message(std::string("there is nothing to show: no ") + entry.text);
    }
    return true;
  }
  return false;
}

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
  d.show_summary();
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
