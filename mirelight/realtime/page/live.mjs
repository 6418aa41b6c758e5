// The page that a person opens: the scene, live, with sliders for the script's attributes.
import * as pc from 'playcanvas';
import { build } from './scene.mjs';
import { CameraControls } from './engine/camera-controls.mjs';

const message = document.getElementById('message');

try {
    const description = await (await fetch('scene.json')).json();
    const view = await build(document.getElementById('view'), description);
    view.app.setCanvasFillMode(pc.FILLMODE_KEEP_ASPECT, description.width, description.height);

    const controls = view.camera.script.create(CameraControls);
    controls.reset(new pc.Vec3(description.camera.target), new pc.Vec3(description.camera.position));

    const form = document.getElementById('controls');
    form.hidden = false;
    message.hidden = true;
    for (const input of form.querySelectorAll('input')) {
        const show = () => { input.nextElementSibling.value = Number(input.value).toFixed(2); };
        input.value = view.relighting[input.name];
        input.addEventListener('input', () => { view.relighting[input.name] = Number(input.value); show(); });
        show();
    }
} catch (error) {
    message.hidden = false;
    message.textContent = String(error);
}
