// The other frames of the run, and the same frame path-traced, laid over the live one.

// A list of the run's frames; choosing one goes to its page, which lies beside this one.
export function addFrames(select, names) {
    const here = decodeURIComponent(location.pathname).split('/').at(-2);
    for (const name of names) select.add(new Option(name, name, name === here, name === here));
    select.addEventListener('change', () => {
        location.href = `../${encodeURIComponent(select.value)}/index.html`;
    });
    select.parentElement.hidden = names.length < 2;
}

// The physical frame from the left edge to where the slider stands. It is of one camera: once the view has been moved it
// goes, and a button brings both back.
export function addPhysical(file, form, view, frame, start) {
    const picture = document.getElementById('physical');
    const { physical: slider, back } = form.elements;
    const width = () => {  // of the picture inside the window
        const fits = Math.min(innerWidth / picture.naturalWidth, innerHeight / picture.naturalHeight);
        return fits * picture.naturalWidth;
    };
    const show = () => {
        const edge = 0.5 * (innerWidth - width()) + slider.value * width();
        picture.style.clipPath = `inset(0 ${innerWidth - edge}px 0 0)`;
        slider.nextElementSibling.value = Number(slider.value).toFixed(2);
    };
    const reach = Math.hypot(...frame.target.map((x, k) => x - frame.position[k]));
    const moved = () => {  // by more than a hundredth of a degree, seen from the frame's target
        const eye = view.camera.getPosition(), ahead = view.camera.forward;
        const off = ['x', 'y', 'z'].map((axis, k) => eye[axis] - frame.position[k]);
        const turned = ['x', 'y', 'z'].map((axis, k) => eye[axis] + reach * ahead[axis] - frame.target[k]);
        return Math.hypot(...off, ...turned) > 2e-4 * reach;
    };
    view.app.on('frameend', () => {
        const away = moved();
        picture.hidden = away || Number(slider.value) === 0;
        slider.disabled = away;
        back.hidden = !away;
    });
    back.addEventListener('click', start);
    slider.addEventListener('input', show);
    addEventListener('resize', show);
    picture.addEventListener('load', show);
    picture.src = file;
    document.getElementById('sides').hidden = false;
}
