"use strict";
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const stage = document.getElementById("stage");
  const label = document.getElementById("label");
  const list = document.getElementById("pieces");
  const slider = document.getElementById("explode");

  const fail = (reason) => {
    stage.classList.add("flat");
    document.getElementById("flat-reason").textContent = reason;
    for (const control of document.querySelectorAll(".tools input, .tools button")) control.disabled = true;
  };

  let renderer;
  try {
    renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true });
  } catch (error) {
    fail("This browser does not support 3-D graphics (WebGL), so here is a picture of the model instead.");
    return;
  }

  const scene = new THREE.Scene();
  const camera = new THREE.PerspectiveCamera(30, 1, 0.01, 50);
  const controls = new THREE.OrbitControls(camera, renderer.domElement);
  controls.enableDamping = true;
  controls.dampingFactor = 0.12;
  const surroundings = new THREE.PMREMGenerator(renderer).fromScene(new THREE.RoomEnvironment(), 0.04).texture;
  scene.environment = surroundings;
  scene.environmentIntensity = 0.45;
  const sun = new THREE.DirectionalLight(0xffffff, 1.5);
  const fill = new THREE.DirectionalLight(0xffffff, 0.45);
  scene.add(sun, fill, new THREE.HemisphereLight(0xffffff, 0x8a8f9a, 0.35));
  renderer.domElement.setAttribute("role", "img");
  renderer.domElement.setAttribute("aria-label", "The assembled device in 3-D: drag to rotate, scroll or pinch to zoom");
  stage.prepend(renderer.domElement);

  const finish = {
    part: { metalness: 0.0, roughness: 0.62 },
    mirror: { metalness: 0.55, roughness: 0.06, color: 0xd6ecff, emissive: 0x6fb1e8, emissiveIntensity: 0.5 },
    camera: { metalness: 0.1, roughness: 0.45 },
    bought: { metalness: 0.9, roughness: 0.35 },
  };
  // From the right of the scene, a little above: glTF has the rig's x to the left.
  const HOME = [-0.72, -0.06, 1.0];
  const accent = new THREE.Color(0xf0821e);
  const pieces = new Map();
  const rays = new THREE.Group();
  const home = new THREE.Sphere();
  let framePending = false;

  const draw = () => {
    if (framePending) return;
    framePending = true;
    requestAnimationFrame(() => {
      framePending = false;
      // The lights follow the viewer.
      sun.position.copy(camera.position).add(new THREE.Vector3(-0.6, 1.0, 0.4).multiplyScalar(home.radius * 3));
      fill.position.copy(camera.position).multiplyScalar(-1);
      if (controls.update()) draw();
      renderer.render(scene, camera);
    });
  };

  const look = (direction) => {
    const [x, y, z] = direction;
    const distance = (home.radius / Math.sin((camera.fov * Math.PI) / 360)) * 0.92 * Math.max(1, 1 / camera.aspect);
    controls.target.copy(home.center);
    camera.position.copy(home.center).add(new THREE.Vector3(x, y, z).normalize().multiplyScalar(distance));
    draw();
  };

  const measure = () => {
    const box = new THREE.Box3();
    for (const piece of pieces.values()) if (piece.node.visible) box.expandByObject(piece.node);
    if (!box.isEmpty()) box.getBoundingSphere(home);
  };

  const explode = (fraction) => {
    for (const { node, shift, rest } of pieces.values()) node.position.copy(rest).addScaledVector(shift, fraction);
    rays.visible = rays.userData.enabled && fraction < 0.02;
    draw();
  };

  let selected = null;
  const light = (piece, on) => {
    piece.node.traverse((child) => {
      if (!child.isMesh) return;
      const { emissive, emissiveIntensity } = child.userData.unlit;
      child.material.emissive.copy(on ? accent : emissive);
      child.material.emissiveIntensity = on ? 0.55 : emissiveIntensity;
    });
    piece.row?.classList.toggle("on", on);
    draw();
  };
  const select = (piece, follow) => {
    if (selected) light(selected, false);
    selected = piece === selected ? null : piece;
    label.hidden = !selected;
    if (!selected) return;
    light(selected, true);
    label.textContent = [selected.number, selected.title].filter(Boolean).join("  ");
    if (follow) selected.row?.scrollIntoView({ block: "nearest", behavior: "smooth" });
  };

  const groups = [
    ["part", "Printed parts"],
    ["mirror", "Mirrors"],
    ["camera", "Camera"],
    ["bought", "Fasteners"],
  ];
  const kindOf = (kind) => (["part", "mirror", "camera"].includes(kind) ? kind : "bought");

  const addRow = (group, piece) => {
    const row = document.createElement("li");
    const box = document.createElement("input");
    box.type = "checkbox";
    box.checked = true;
    box.setAttribute("aria-label", `show ${piece.title} ${piece.number}`);
    box.addEventListener("change", () => {
      piece.node.visible = box.checked;
      draw();
    });
    const name = document.createElement("button");
    name.type = "button";
    const dot = document.createElement("i");
    dot.style.background = `#${piece.colour.getHexString()}`;
    const number = document.createElement("span");
    number.textContent = piece.number;
    name.append(dot, piece.title, number);
    name.addEventListener("click", () => select(piece, false));
    row.addEventListener("pointerenter", () => piece !== selected && light(piece, true));
    row.addEventListener("pointerleave", () => piece !== selected && light(piece, false));
    row.append(box, name);
    group.append(row);
    piece.row = row;
    piece.box = box;
  };

  const build = (gltf) => {
    const root = gltf.scene;
    scene.add(root);
    const nodes = [];
    root.traverse((node) => node.userData.kind && nodes.push(node));
    for (const node of nodes) {
      const { kind, number = "", title = node.name, explode_mm: shift = [0, 0, 0] } = node.userData;
      const piece = { node, kind: kindOf(kind), number, title, shift: new THREE.Vector3(...shift) };
      piece.rest = node.position.clone();
      const meshes = [];
      node.traverse((child) => child.isMesh && meshes.push(child));
      for (const mesh of meshes) {
        const flatShading = !mesh.geometry.attributes.normal;
        mesh.material = new THREE.MeshStandardMaterial({ color: mesh.material.color, flatShading, ...finish[piece.kind] });
        mesh.userData.unlit = { emissive: mesh.material.emissive.clone(), emissiveIntensity: mesh.material.emissiveIntensity };
        piece.colour = mesh.material.color.clone();
        const edges = new THREE.EdgesGeometry(mesh.geometry, 24);
        const ink = new THREE.LineBasicMaterial({ color: 0x0c1018, transparent: true, opacity: 0.38 });
        mesh.add(new THREE.LineSegments(edges, ink));
      }
      pieces.set(node.name, piece);
    }
    const device = nodes[0].parent;
    const paths = new THREE.LineBasicMaterial({ color: accent });
    for (const path of data.rays_mm) {
      const points = path.map((point) => new THREE.Vector3(...point));
      rays.add(new THREE.Line(new THREE.BufferGeometry().setFromPoints(points), paths));
    }
    rays.userData.enabled = false;
    rays.visible = false;
    device.add(rays);

    for (const [kind, title] of groups) {
      const members = [...pieces.values()].filter((piece) => piece.kind === kind);
      if (!members.length) continue;
      const group = document.createElement("details");
      group.open = kind === "part";
      const summary = document.createElement("summary");
      const box = document.createElement("input");
      box.type = "checkbox";
      box.checked = true;
      box.setAttribute("aria-label", `show ${title}`);
      box.addEventListener("click", (event) => event.stopPropagation());
      box.addEventListener("change", () => {
        for (const piece of members) piece.node.visible = piece.box.checked = box.checked;
        draw();
      });
      summary.append(box, `${title} `, Object.assign(document.createElement("span"), { textContent: members.length }));
      const rows = document.createElement("ul");
      group.append(summary, rows);
      for (const piece of members) addRow(rows, piece);
      if (kind === "part" && data.not_shown) {
        group.append(Object.assign(document.createElement("p"), { className: "note", textContent: data.not_shown }));
      }
      list.append(group);
    }
    measure();
    resize();
    look(HOME);
    stage.dataset.ready = String(pieces.size);
  };

  const resize = () => {
    const { clientWidth: width, clientHeight: height } = stage;
    renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    draw();
  };
  new ResizeObserver(resize).observe(stage);

  const caster = new THREE.Raycaster();
  let pressed = null;
  renderer.domElement.addEventListener("pointerdown", (event) => (pressed = [event.clientX, event.clientY]));
  renderer.domElement.addEventListener("click", (event) => {
    // The end of a drag does not select a piece.
    if (pressed && Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) > 5) return;
    const box = renderer.domElement.getBoundingClientRect();
    const point = new THREE.Vector2(
      ((event.clientX - box.left) / box.width) * 2 - 1,
      1 - ((event.clientY - box.top) / box.height) * 2,
    );
    caster.setFromCamera(point, camera);
    const visible = [...pieces.values()].filter((piece) => piece.node.visible);
    const hit = caster.intersectObjects(visible.map((piece) => piece.node), true).find(({ object }) => object.isMesh);
    const piece = hit && visible.find(({ node }) => node === hit.object || node.getObjectById(hit.object.id));
    if (piece) select(piece, true);
    else if (selected) select(selected, false);
  });
  controls.addEventListener("change", draw);
  slider.addEventListener("input", () => {
    // The viewer moves back as the exploded view grows, without changing its direction of view.
    const [center, radius] = [home.center.clone(), home.radius];
    explode(slider.valueAsNumber / 100);
    measure();
    camera.position.sub(center).multiplyScalar(home.radius / radius).add(home.center);
    controls.target.add(home.center).sub(center);
    draw();
  });
  document.getElementById("rays").addEventListener("change", (event) => {
    rays.userData.enabled = event.target.checked;
    explode(slider.valueAsNumber / 100);
  });
  for (const button of document.querySelectorAll("[data-look]")) {
    button.addEventListener("click", () => {
      measure();
      look(JSON.parse(button.dataset.look));
    });
  }
  // A link may request an exploded view: index.html#explode=60
  const requested = /explode=(\d+)/.exec(location.hash);

  const text = document.getElementById("glb").textContent;
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  new THREE.GLTFLoader().parse(
    bytes.buffer,
    "",
    (gltf) => {
      build(gltf);
      if (requested) {
        slider.value = requested[1];
        explode(slider.valueAsNumber / 100);
        measure();
        look(HOME);
      }
    },
    (error) => fail(`The 3-D model could not be read: ${error.message ?? error}`),
  );
})();
