// The page that a person opens: the scene, live, with sliders for the script's attributes.
import * as pc from 'playcanvas';
import { build } from './scene.mjs';
import { CameraControls } from './engine/camera-controls.mjs';
import { addFrames, addPhysical } from './sides.mjs';

const message = document.getElementById('message');

try {
    const description = await (await fetch('scene.json')).json();
    const view = await build(document.getElementById('view'), description);
    view.app.setCanvasFillMode(pc.FILLMODE_FILL_WINDOW);
    view.app.setCanvasResolution(pc.RESOLUTION_AUTO);
    // on a screen that is narrower than the frame, the view opens until the whole frame is seen
    const { width, height, camera: { fov } } = description;
    const fit = () => {
        view.app.resizeCanvas();
        const narrower = Math.max(1, (width / height) / (innerWidth / innerHeight));
        view.camera.camera.fov = 2 * Math.atan(Math.tan(fov * Math.PI / 360) * narrower) * 180 / Math.PI;
    };
    addEventListener('resize', fit);
    fit();

    const controls = view.camera.script.create(CameraControls);
    const start = () => {  // at once, where `reset` would swing there
        view.camera.setPosition(new pc.Vec3(description.camera.position));
        controls.focusPoint = new pc.Vec3(description.camera.target);
    };
    start();

    const form = document.getElementById('controls');
    for (const light of view.lights) {
        const label = document.createElement('label');
        const box = Object.assign(document.createElement('input'), { type: 'checkbox', checked: true, name: light.name });
        box.addEventListener('change', () => { light.enabled = box.checked; });
        label.append(light.name, box);
        document.getElementById('lights').append(label);
    }
    const known = await (await fetch('page.json')).json();
    addFrames(form.elements.frame, known.frames);
    if (known.physical) addPhysical(known.physical, form, view, description.camera, start);
    for (const input of document.querySelectorAll('#controls > label > input[type=range]')) {
        const show = () => { input.nextElementSibling.value = Number(input.value).toFixed(2); };
        input.value = view.relighting[input.name];
        input.addEventListener('input', () => { view.relighting[input.name] = Number(input.value); show(); });
        show();
    }
    form.hidden = false;  // not before all is in place: what is moved earlier would be lost
    message.hidden = true;
} catch (error) {
    message.hidden = false;
    message.textContent = String(error);
}
