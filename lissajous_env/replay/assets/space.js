// Three-dimensional view by three.js: the curve, the robots, and their sensing discs on the ground.

import { robotColour } from "./colours.js";
import { edges } from "./derived.js";
import { REMOVED, STUCK, WORKING } from "./episode.js";
import { Ground } from "./ground.js";
import { legendOf } from "./legend.js";
import { trailOf } from "./stage.js";

const THIN = 0.006;
const FILLED = 0.96;

export class Space {
  // Throws without WebGL.
  constructor(canvas, episode) {
    const T = (this.T = globalThis.THREE);
    Object.assign(this, { canvas, episode, ground: new Ground(episode), edges: edges(episode) });
    this.renderer = new T.WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.scene = new T.Scene();
    this.reach = Math.hypot(...episode.about.half);
    this.camera = new T.PerspectiveCamera(32, 2, 0.01 * this.reach, 100 * this.reach);
    this.camera.up.set(0, 0, 1);
    this.camera.position.set(0, -this.reach, this.reach);
    this.controls = new T.OrbitControls(this.camera, canvas);
    this.controls.target.set(0, 0, 0);
    this.controls.maxPolarAngle = 0.62 * Math.PI;
    this.controls.addEventListener("change", () => this.again());
    this.controls.addEventListener("start", () => {
      this.looked = true;
    });
    this.scene.add(new T.AmbientLight("#ffffff", 1.6));
    const sun = new T.DirectionalLight("#ffffff", 1.8);
    sun.position.set(-1, -2, 4);
    this.scene.add(sun);
    this.addGround();
    this.addCurve();
    this.addTargets();
    this.addRobots();
    this.theme = "";
  }

  legend(layer) {
    return legendOf(this.episode, this.ground, layer);
  }

  heightFor(width) {
    return Math.round(Math.max(0.56 * width, 240));
  }

  resize(width, height, ratio) {
    Object.assign(this, { width, height });
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    if (!this.looked) this.whole();
  }

  // Look from the front and above, at the distance where the curve and the robots just fit.
  whole() {
    const T = this.T,
      { half, radius } = this.episode.about;
    const corners = [-1, 1].flatMap((x) =>
      [-1, 1].flatMap((y) => [-1, 1].map((z) => [x, y, z].map((sign, axis) => sign * (half[axis] + radius)))),
    );
    let [near, far] = [1, 40];
    for (let k = 0; k < 24; k++) {
      const away = (near + far) / 2;
      this.camera.position.set(-0.21, -0.82, 0.54).multiplyScalar(away * this.reach);
      this.camera.lookAt(0, 0, 0);
      this.camera.updateMatrixWorld();
      const fits = corners.every((corner) => {
        const { x, y } = new T.Vector3(...corner).project(this.camera);
        return Math.max(Math.abs(x), Math.abs(y)) < FILLED;
      });
      [near, far] = fits ? [near, away] : [away, far];
    }
    this.controls.target.set(0, 0, 0);
    this.controls.update();
    this.looked = false;
  }

  zoomBy(factor) {
    const { target } = this.controls;
    this.camera.position.sub(target).divideScalar(factor).add(target);
    this.looked = true;
    this.controls.update();
  }

  // Pan [px].
  panBy(right, down) {
    const { camera, controls, T } = this;
    const metres = (2 * camera.position.distanceTo(controls.target) * Math.tan((camera.fov * Math.PI) / 360)) / this.height;
    const way = new T.Vector3(-right * metres, down * metres, 0).applyQuaternion(camera.quaternion);
    camera.position.add(way);
    controls.target.add(way);
    this.looked = true;
    controls.update();
  }

  line(points, closed = false) {
    const T = this.T,
      geometry = new T.BufferGeometry();
    geometry.setAttribute("position", new T.Float32BufferAttribute(points, 3));
    const made = new (closed ? T.LineLoop : T.Line)(geometry, new T.LineBasicMaterial({ transparent: true }));
    made.frustumCulled = false;
    this.scene.add(made);
    return made;
  }

  addGround() {
    const T = this.T,
      [a, b] = this.episode.about.half;
    const shape = new T.PlaneGeometry(2 * a, 2 * b);
    this.plane = new T.Mesh(
      shape,
      new T.MeshBasicMaterial({ side: T.DoubleSide, transparent: true, opacity: 0.45, depthWrite: false }),
    );
    this.plane.position.z = -0.003 * this.reach;
    this.heat = new T.Mesh(
      shape,
      new T.MeshBasicMaterial({ transparent: true, side: T.DoubleSide, depthWrite: false }),
    );
    this.scene.add(this.plane, this.heat);
    this.edge = this.line([-a, -b, 0, a, -b, 0, a, b, 0, -a, b, 0], true);
  }

  addCurve() {
    const T = this.T,
      { curve } = this.episode,
      count = curve.length / 3,
      every = Math.ceil(count / 900);
    const points = [];
    for (let k = 0; k < count - 1; k += every)
      points.push(new T.Vector3(curve[k], curve[count + k], curve[2 * count + k]));
    const way = new T.CatmullRomCurve3(points, true);
    const thick = THIN * this.episode.about.half[0];
    this.knot = new T.Mesh(new T.TubeGeometry(way, 1200, thick, 8, true), new T.MeshLambertMaterial());
    this.scene.add(this.knot);
  }

  addTargets() {
    const T = this.T,
      size = 0.022 * this.episode.about.half[0],
      count = Math.max(this.episode.raw.targets.count, 1);
    this.targets = new T.InstancedMesh(new T.SphereGeometry(size, 12, 8), new T.MeshLambertMaterial(), count);
    this.targets.frustumCulled = false;
    this.scene.add(this.targets);
  }

  addRobots() {
    const T = this.T,
      { about, count } = this.episode;
    const body = new T.SphereGeometry(about.radius, 32, 20),
      around = new T.SphereGeometry(1.45 * about.radius, 32, 20);
    const disc = new T.RingGeometry(0.992 * about.sensing, about.sensing, 128);
    this.back = trailOf(this.episode);
    this.robots = Array.from({ length: count }, (_, i) => {
      const ball = new T.Mesh(body, new T.MeshLambertMaterial());
      ball.userData.robot = i;
      const halo = new T.MeshBasicMaterial({ side: T.BackSide, transparent: true, opacity: 0.55, depthWrite: false });
      const shell = new T.Mesh(around, halo);
      const sensed = new T.Mesh(disc, new T.MeshBasicMaterial({ transparent: true, opacity: 0.4, side: T.DoubleSide }));
      const sign = new T.Sprite(new T.SpriteMaterial({ depthTest: false }));
      sign.scale.setScalar(2.3 * about.radius);
      const fall = this.line(new Float32Array(6)),
        trail = this.line(new Float32Array(3 * (this.back + 2)));
      this.scene.add(ball, shell, sensed, sign);
      return { ball, shell, sensed, sign, fall, trail };
    });
    this.links = this.edges.map(() => this.line(new Float32Array(6)));
  }

  paint(colours) {
    if (this.theme === colours.card) return;
    this.theme = colours.card;
    this.plane.material.color.set(colours.ground);
    this.edge.material.color.set(colours.edge);
    this.knot.material.color.set(colours.curve);
    this.robots.forEach((robot, i) => {
      const colour = robotColour(colours, i);
      robot.ball.material.color.set(colour);
      robot.trail.material.color.set(colour);
      robot.fall.material.color.set(colours.muted);
      robot.sensed.material.color.set(colours.sensing);
      robot.sign.material.map = this.numbered(i, colours);
      robot.sign.material.needsUpdate = true;
    });
  }

  numbered(robot, colours) {
    const canvas = document.createElement("canvas"),
      context = canvas.getContext("2d");
    canvas.width = canvas.height = 96;
    context.font = "700 58px system-ui, sans-serif";
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.lineWidth = 12;
    context.lineJoin = "round";
    context.strokeStyle = colours.card;
    context.strokeText(String(robot), 48, 50);
    context.fillStyle = colours.ink;
    context.fillText(String(robot), 48, 50);
    const texture = new this.T.CanvasTexture(canvas);
    texture.colorSpace = this.T.SRGBColorSpace;
    return texture;
  }

  draw(time, view) {
    this.latest = [time, view];
    const at = this.episode.at(time),
      { colours } = view;
    this.paint(colours);
    this.lay(view, at);
    const places = this.robots.map((_, i) => this.place(i, at));
    this.robots.forEach((robot, i) => this.move(robot, i, places[i], at, view));
    this.links.forEach((link, k) => {
      const [i, j] = this.edges[k],
        lost = this.episode.isCut(i, j, at.moment);
      this.stretch(link, [...places[i], ...places[j]]);
      link.material.color.set(lost ? colours.lost : colours.link);
      link.material.opacity = lost ? 0.9 : 0.5;
    });
    this.moveTargets(at, colours);
    this.renderer.render(this.scene, this.camera);
  }

  again() {
    if (this.latest) this.draw(...this.latest);
  }

  place(i, at) {
    const { x, y, z } = this.episode.robots;
    return [x, y, z].map((values) => this.episode.glide(values, i, at));
  }

  lay(view, at) {
    const picture = this.ground.picture(view.layer, at.now, view.colours),
      key = `${view.layer} ${this.ground.shown}`;
    this.heat.visible = picture !== null;
    if (!picture || key === this.laid) return;
    this.laid = key;
    if (this.heat.material.map) this.heat.material.map.dispose();
    this.heat.material.map = new this.T.CanvasTexture(picture);
    this.heat.material.map.colorSpace = this.T.SRGBColorSpace;
    this.heat.material.needsUpdate = true;
  }

  move(robot, i, [x, y, z], at, view) {
    const { episode } = this,
      status = episode.robots.status[i * episode.moments + at.moment];
    robot.ball.position.set(x, y, z);
    robot.ball.visible = robot.fall.visible = status !== REMOVED;
    const touches = episode.raw.contacts.some(
      ([one, other, first, last]) => (one === i || other === i) && first <= at.moment && at.moment <= last,
    );
    const { colours } = view,
      stuck = status === STUCK;
    robot.shell.visible = touches || stuck || i === view.selected;
    robot.shell.material.color.set(touches ? colours.touch : stuck ? colours.stuck : colours.ink);
    robot.shell.position.set(x, y, z);
    robot.sensed.position.set(x, y, 0.002 * this.reach);
    robot.sensed.visible = status === WORKING;
    robot.sign.position.set(x, y, z + 1.9 * episode.about.radius);
    this.stretch(robot.fall, [x, y, z, x, y, 0]);
    const trail = robot.trail.geometry.attributes.position,
      row = i * episode.moments;
    for (let k = 0; k <= this.back; k++) {
      const f = row + Math.max(at.moment - this.back + k, 0);
      trail.setXYZ(k, episode.robots.x[f], episode.robots.y[f], episode.robots.z[f]);
    }
    trail.setXYZ(this.back + 1, x, y, z);
    trail.needsUpdate = true;
  }

  stretch(line, ends) {
    line.geometry.attributes.position.array.set(ends);
    line.geometry.attributes.position.needsUpdate = true;
  }

  moveTargets(at, colours) {
    const T = this.T,
      { raw, targets } = this.episode,
      step = at.now * raw.every;
    const matrix = new T.Matrix4(),
      colour = new T.Color();
    for (let t = 0; t < this.targets.count; t++) {
      const found = raw.targets.found[t],
        seen = found >= 0 && found <= step;
      const age = seen ? ((step - found) * raw.step) / this.episode.about.flash : 0;
      const shown =
        t < raw.targets.count && raw.targets.appears[t] <= step && (!seen || age < 1 || !this.episode.about.leave);
      const size = !shown ? 0 : seen && this.episode.about.leave ? 1 + age * (1 - age) * 3 : 1;
      matrix.makeScale(size, size, size);
      if (shown) matrix.setPosition(this.episode.between(targets.x, t, at), this.episode.between(targets.y, t, at), 0);
      this.targets.setMatrixAt(t, matrix);
      this.targets.setColorAt(t, colour.set(seen ? colours.found : colours.target));
    }
    this.targets.instanceMatrix.needsUpdate = true;
    this.targets.instanceColor.needsUpdate = true;
  }

  // Return the robot at a place [px], or -1.
  pick(x, y) {
    const { clientWidth, clientHeight } = this.canvas;
    const ray = new this.T.Raycaster();
    ray.setFromCamera(new this.T.Vector2((2 * x) / clientWidth - 1, 1 - (2 * y) / clientHeight), this.camera);
    const [hit] = ray.intersectObjects(this.robots.map((robot) => robot.ball));
    return hit ? hit.object.userData.robot : -1;
  }
}
