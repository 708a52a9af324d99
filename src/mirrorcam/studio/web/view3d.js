"use strict";
// Mirrors, chief rays, light and the device in 3-D. Drawings are in view axes; in three.js, y is up and the scene at -z.
(() => {
  const toThree = ([x, y, z]) => [x, -y, -z];
  const HOME = [0.8, 0.25, -0.55];

  class View3D {
    constructor(stage, colours) {
      Object.assign(this, { stage, colours, layers: new Map(), shown: { rays: true, light: false, compared: true, device: true, scale: true } });
      this.renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true });
      this.scene = new THREE.Scene();
      this.camera = new THREE.PerspectiveCamera(30, 1, 0.1, 20000);
      this.controls = new THREE.OrbitControls(this.camera, this.renderer.domElement);
      this.controls.enableDamping = false;
      this.controls.addEventListener("change", () => this.draw());
      this.sun = new THREE.DirectionalLight(0xffffff, 2.2);
      this.scene.add(this.sun, new THREE.HemisphereLight(0xffffff, 0x9097a5, 1.6));
      this.world = new THREE.Group();
      this.scene.add(this.world);
      const canvas = this.renderer.domElement;
      // A finger that moves up or down scrolls the page; what it turned until then is undone.
      canvas.style.touchAction = "pan-y";
      canvas.addEventListener("pointerdown", () => this.controls.saveState());
      canvas.addEventListener("pointercancel", () => this.controls.reset());
      canvas.setAttribute("role", "img");
      canvas.setAttribute("aria-label", "The mirrors in 3-D: drag to rotate, scroll or pinch to zoom; buttons rotate it, too");
      stage.prepend(canvas);
      new ResizeObserver(() => this.resize()).observe(stage);
      this.resize();
    }

    resize() {
      const { clientWidth: width, clientHeight: height } = this.stage;
      if (!width || !height) return;
      this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
      this.renderer.setSize(width, height, false);
      this.camera.aspect = width / height;
      this.camera.updateProjectionMatrix();
      if (this.radius && !this.touched) this.look(HOME);
      this.draw();
    }

    draw() {
      if (this.isScheduled) return;
      this.isScheduled = true;
      requestAnimationFrame(() => {
        this.isScheduled = false;
        this.sun.position.copy(this.camera.position).add(new THREE.Vector3(-200, 400, 100));
        this.renderer.render(this.scene, this.camera);
      });
    }

    look(direction) {
      const [x, y, z] = direction;
      const distance = (this.radius / Math.sin((this.camera.fov * Math.PI) / 360)) * 0.78 * Math.max(1, 1 / this.camera.aspect);
      this.controls.target.copy(this.centre);
      this.camera.position.copy(this.centre).add(new THREE.Vector3(x, y, z).normalize().multiplyScalar(distance));
      this.controls.update();
      this.draw();
    }

    replace(name, group) {
      const previous = this.layers.get(name);
      if (previous) {
        this.world.remove(previous);
        previous.traverse((node) => node.geometry?.dispose());
      }
      this.layers.set(name, group);
      if (group) this.world.add(group);
    }

    prism(solid) {
      const count = solid.length / 2;
      const corners = solid.flatMap(toThree);
      const index = [];
      for (let i = 1; i < count - 1; i += 1) index.push(0, i, i + 1, count, count + i + 1, count + i);
      for (let i = 0; i < count; i += 1) {
        const j = (i + 1) % count;
        index.push(i, count + i, j, j, count + i, count + j);
      }
      const geometry = new THREE.BufferGeometry();
      geometry.setAttribute("position", new THREE.Float32BufferAttribute(corners, 3));
      geometry.setIndex(index);
      return geometry;
    }

    lines(segments, material) {
      const geometry = new THREE.BufferGeometry();
      geometry.setAttribute("position", new THREE.Float32BufferAttribute(segments.flatMap(toThree), 3));
      return new THREE.LineSegments(geometry, material);
    }

    edges(prism, material) {
      return new THREE.LineSegments(new THREE.EdgesGeometry(prism), material);
    }

    ink(colour, opacity = 1) {
      return new THREE.LineBasicMaterial({ color: colour, transparent: opacity < 1, opacity });
    }

    cross([x, y, z], size) {
      return [[x - size, y, z], [x + size, y, z], [x, y - size, z], [x, y + size, z], [x, y, z - size], [x, y, z + size]];
    }

    // Mirrors, chief rays and the camera, also of an infeasible design.
    bodies({ mirrors: drawings, body_mm: box }, concerned = []) {
      const { colours } = this;
      const mirrors = new THREE.Group();
      // Double-sided, without normals: flat shading computes them for each face.
      const glass = (colour) =>
        new THREE.MeshStandardMaterial({
          color: colour, flatShading: true, side: THREE.DoubleSide, metalness: 0.1, roughness: 0.35, emissive: colour, emissiveIntensity: 0.35,
        });
      const [plain, wrong, edge] = [glass(colours.mirror), glass(colours.bad), this.ink(colours.ink, 0.65)];
      drawings.forEach(({ solid_mm: solid }, k) => {
        const prism = this.prism(solid);
        mirrors.add(new THREE.Mesh(prism, concerned.includes(k) ? wrong : plain), this.edges(prism, edge));
      });
      this.replace("mirrors", mirrors);
      const rays = new THREE.Group();
      rays.add(this.lines(drawings.flatMap(({ chief_mm: [a, b, c] }) => [a, b, b, c]), this.ink(colours.ray)));
      this.replace("rays", rays);
      const body = new THREE.Group();
      body.add(this.lines(this.cross([0, 0, 0], 2), this.ink(colours.ink)));
      if (box.length) {
        const pairs = [];
        box.forEach((p, i) => [1, 2, 4].forEach((bit) => !(i & bit) && pairs.push(p, box[i | bit])));
        body.add(this.lines(pairs, this.ink(colours.soft)));
      }
      this.replace("body", body);
    }

    // The mirrors that violate a request least, with thick marks where they do.
    showViolation(drawing) {
      this.bodies(drawing, drawing.concerned);
      for (const name of ["cameras", "compared", "light"]) this.replace(name, null);
      const marks = new THREE.Group();
      const size = this.size(drawing) * 0.02;
      for (const [from, to] of drawing.places_mm) {
        marks.add(this.lines([from, to, ...this.cross(from, size), ...this.cross(to, size)], this.ink(this.colours.bad)));
      }
      this.replace("places", marks);
      this.measure(drawing);
      this.visible();
    }

    show(drawing, compared, depth) {
      const { colours } = this;
      this.bodies(drawing);
      this.replace("places", null);
      const cameras = new THREE.Group();
      const size = this.size(drawing) * 0.012;
      cameras.add(this.lines(drawing.centres_mm.flatMap((point) => this.cross(point, size)), this.ink(colours.view)));
      const grid = drawing.neighbours.flatMap(([i, j]) => [drawing.grid_mm[i], drawing.grid_mm[j]]);
      cameras.add(this.lines(grid, this.ink(colours.soft, 0.6)));
      this.replace("cameras", cameras);

      const ghost = new THREE.Group();
      for (const { solid_mm: solid } of compared?.mirrors ?? []) ghost.add(this.edges(this.prism(solid), this.ink(colours.soft, 0.55)));
      this.replace("compared", ghost);

      this.light(drawing, depth);
      this.measure(drawing);
      this.visible();
    }

    // The light of each view, from its mirror to the plane at a depth.
    light(drawing, depth) {
      const group = new THREE.Group();
      if (this.shown.light && depth) {
        const material = new THREE.MeshBasicMaterial({
          color: this.colours.ray, transparent: true, opacity: 0.1, side: THREE.DoubleSide, depthWrite: false,
        });
        const { mirror, points_mm: points, directions } = drawing.rays;
        drawing.mirrors.forEach((_, k) => {
          const indices = mirror.map((m, i) => (m === k ? i : -1)).filter((i) => i >= 0);
          const corners = indices.flatMap((i) => {
            const step = depth - points[i][2];
            return [points[i], points[i].map((p, axis) => p + step * directions[i][axis])];
          });
          const index = indices.flatMap((_, i) => {
            const [a, b] = [2 * i, 2 * ((i + 1) % indices.length)];
            return [a, a + 1, b, b, a + 1, b + 1];
          });
          const geometry = new THREE.BufferGeometry();
          geometry.setAttribute("position", new THREE.Float32BufferAttribute(corners.flatMap(toThree), 3));
          geometry.setIndex(index);
          group.add(new THREE.Mesh(geometry, material));
        });
      }
      this.replace("light", group);
    }

    size(drawing) {
      const all = drawing.mirrors.flatMap(({ solid_mm: s }) => s);
      return Math.max(...[0, 1, 2].map((axis) => Math.max(...all.map((p) => p[axis])) - Math.min(...all.map((p) => p[axis]))));
    }

    // The scale of the picture stays, so that a larger device looks larger; `fit` shows all of it.
    measure(drawing) {
      this.box = new THREE.Box3();
      const points = drawing.mirrors.flatMap(({ solid_mm: s, chief_mm: c }) => [...s, c[0], c[1]]);
      for (const point of [...points, ...(drawing.centres_mm ?? []), ...drawing.body_mm]) this.box.expandByPoint(new THREE.Vector3(...toThree(point)));
      if (!this.floor) {
        this.floor = this.box.min.y - 10;
        this.aside = Math.max(Math.abs(this.box.min.x), this.box.max.x);
      }
      const scale = new THREE.Group();
      const segments = Studio.scaleSegments(this.floor, this.aside);
      scale.add(new THREE.LineSegments(new THREE.BufferGeometry().setAttribute("position", new THREE.Float32BufferAttribute(segments.flat(), 3)), this.ink(this.colours.soft)));
      this.replace("scale", scale);
      if (!this.radius) this.fit();
    }

    // Show all of the device, and what is beside it.
    fit() {
      const box = new THREE.Box3().copy(this.box);
      for (const name of ["device", "scale"]) {
        const layer = this.layers.get(name);
        if (layer && this.shown[name]) box.expandByObject(layer);
      }
      const sphere = box.getBoundingSphere(new THREE.Sphere());
      [this.centre, this.radius] = [sphere.center, sphere.radius];
      this.look(this.direction ?? HOME);
    }

    home(direction) {
      this.direction = direction;
      this.look(direction);
    }

    // The parts of the device from its GLB file, which is in the rig's frame below its root; none without an address.
    device(address, viewFromRig) {
      if (this.model === address) return;
      this.model = address;
      this.replace("device", null);
      this.draw();
      if (!address) return;
      new THREE.GLTFLoader().load(address, ({ scene }) => {
        if (this.model !== address) return;
        const [a, b, c] = viewFromRig;
        const [root] = scene.children;
        root.matrixAutoUpdate = false;
        root.matrix.set(...a, 0, ...b.map((v) => -v), 0, ...c.map((v) => -v), 0, 0, 0, 0, 1);
        root.traverse((node) => {
          if (node.userData.kind === "mirror") node.visible = false;
        });
        this.replace("device", scene);
        this.visible();
      });
    }

    visible() {
      for (const name of ["rays", "light", "compared", "device", "scale"]) {
        const layer = this.layers.get(name);
        if (layer) layer.visible = this.shown[name];
      }
      this.draw();
    }

    recolour(colours) {
      this.colours = colours;
    }
  }
  Studio.View3D = View3D;
})();
